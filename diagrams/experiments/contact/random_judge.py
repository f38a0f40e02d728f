"""Judges each random touch by all that it has to meet."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from pydrake.systems.framework import Context

from experiments.contact import judge
from experiments.contact.cell import ContactCell
from experiments.contact.random_touches import RandomTouch
from experiments.trials import again, share_metrics
from saphari_drake.errors import SensorError
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.record.log import Log
from saphari_drake.simulation.runner.limits import limit_metrics
from saphari_drake.simulation.runner.results import Metric
from saphari_drake.simulation.sensors.visibility import pixels_near
from saphari_drake.simulation.view.figures import BOUND, CYCLE, blank, legend

Array = NDArray[np.float64]

FORCE, DEFLECTION, POINT, RETURN = 0.10, 0.10, 0.010, 0.002  # what a touch has to meet: shares, m, m
HIDDEN_POINT = 0.020  # m, the same of a touch that the camera does not see
DELAY = 0.05  # s
VISIBLE_PIXELS, VISIBLE_RADIUS = 12, 0.03  # a touch is seen if so many pixels of the person lie so near (m)
NEVER = 1.0  # error of what did not happen


class JudgedTouch(NamedTuple):
    """One random touch; errors of a touch that was not answered are `NEVER`."""

    trial: int
    link: int
    force: float  # N, asked of the hand
    finger_radius: float  # m
    seen: float  # 1: the camera sees enough of the person near the contact
    force_error: float  # of the observable part
    deflection_error: float  # of the observable part
    point_error: float  # m, median
    unanswered: float  # share of the touch
    return_error: float  # m, what is left `watched` seconds after the release
    delay: float  # s
    speed_share: float  # largest |v| / v_max at any 1 ms sample
    wander: float  # m, the farthest that is left from then on
    torque_excess: float  # Nm

    @property
    def point_met(self) -> bool:
        """Whether the contact point was found as near as it has to be."""
        return self.point_error <= (POINT if self.seen else HIDDEN_POINT)

    @property
    def meets_all(self) -> bool:
        """Whether the touch was found, felt, answered and returned from as it has to be."""
        return (
            self.force_error <= FORCE
            and self.deflection_error <= DEFLECTION
            and self.point_met
            and self.return_error <= RETURN
        )

    def worse_than(self, other: JudgedTouch) -> bool:
        """Whether this touch fails where another does not, or the arm is left farther away."""
        return (self.meets_all, -self.wander) < (other.meets_all, -other.wander)


def is_seen(parts: ContactCell, root: Context, robot: RobotModel, p_W: Array) -> bool:
    """Whether the camera sees enough of the person near a point (m) at the time of a root context, without noise."""
    image = parts.camera.GetOutputPort("depth_image_32f").Eval(parts.camera.GetMyContextFromRoot(root)).data[..., 0]
    state = parts.cell.robot_state.Eval(parts.cell.plant.GetMyContextFromRoot(root))
    terms = evaluate_dynamics(robot, state[: robot.n], np.zeros(robot.n))
    camera = parts.camera_parameters
    return pixels_near(image, camera, robot, terms, p_W, VISIBLE_RADIUS) >= VISIBLE_PIXELS


def judged_touch(
    robot: RobotModel, trial: int, drawn: RandomTouch, log: Log, fast: Log, seen: bool, K_p: Array, watched: float
) -> JudgedTouch:
    """Judge the log of one touch; `fast` holds velocity and torque_excess at every step of the plant."""
    speed, excess = limit_metrics(robot, fast["velocity"], fast["torque_excess"])
    shared: dict[str, Any] = {
        "trial": trial,
        "link": robot.link_index(drawn.push.link),
        "force": drawn.push.force,
        "finger_radius": drawn.finger_radius,
        "seen": float(seen),
        "speed_share": speed.value,
        "torque_excess": excess.value,
    }
    try:
        (touch,) = judge.find_touches(log, robot, [drawn.push])
    except SensorError:  # the arm left before it was touched
        never: dict[str, Any] = dict.fromkeys(
            ("force_error", "deflection_error", "point_error", "return_error", "wander"), NEVER
        )
        return JudgedTouch(**shared, **never, unanswered=1.0, delay=NEVER)
    found = judge.localized(log, touch)
    later = np.flatnonzero(log.time >= min(log.time[touch.release] + watched, log.time[-1]) - 1e-9)
    left = np.linalg.norm(judge.deflection(log, robot, touch, later), axis=1)
    answered = found.unanswered <= judge.UNANSWERED
    return JudgedTouch(
        **shared,
        force_error=observable_force_error(log, robot, touch) if answered else NEVER,
        deflection_error=observable_deflection_error(log, robot, touch, K_p) if answered else NEVER,
        point_error=min(found.median, NEVER) if answered else NEVER,
        unanswered=found.unanswered,
        return_error=float(left[0]),
        delay=float(np.nan_to_num(judge.detection_delay(log, touch), nan=NEVER)),
        wander=float(left.max()),
    )


def observable_directions(log: Log, robot: RobotModel, touch: judge.Touch) -> Array:
    """Return the projector (3, 3) on the directions of a force at the true point that joint torques show."""
    q = log["position"][judge.steady(log, touch)].mean(axis=0)
    J = evaluate_dynamics(robot, q, np.zeros(robot.n)).point(touch.link, touch.p_LC).Jv_WC
    U, s, _ = np.linalg.svd(J, full_matrices=False)
    shown = U[:, s > max(0.02 * s[0], 0.02)]
    return np.asarray(shown @ shown.T)


def observable_force_error(log: Log, robot: RobotModel, touch: judge.Touch) -> float:
    """Return ‖P(F̂ − F)‖ / ‖PF‖ of the means in the steady part, P on what joint torques show."""
    P, rows = observable_directions(log, robot, touch), judge.steady(log, touch)
    true = P @ log["contact_truth"][rows, :3].mean(axis=0)
    estimated = P @ log["contact_force"][rows].mean(axis=0)
    return float(np.linalg.norm(estimated - true) / np.linalg.norm(true))


def observable_deflection_error(log: Log, robot: RobotModel, touch: judge.Touch, K_p: Array) -> float:
    """Return ‖P(Δx − F/K_p)‖ / ‖P F/K_p‖ of the means in the steady part."""
    P, rows = observable_directions(log, robot, touch), judge.steady(log, touch)
    expected = P @ (log["contact_truth"][rows, :3].mean(axis=0) / K_p)
    moved = P @ judge.deflection(log, robot, touch, rows).mean(axis=0)
    return float(np.linalg.norm(moved - expected) / np.linalg.norm(expected))


def random_metrics(touches: list[JudgedTouch]) -> list[Metric]:
    """Return shares and worst values over all touches; none decides yet."""
    seen = [touch for touch in touches if touch.seen]
    hidden = [touch for touch in touches if not touch.seen]

    def share(some: list[JudgedTouch], met: Callable[[JudgedTouch], bool]) -> float:
        return float(np.mean([met(touch) for touch in some])) if some else float("nan")

    def open_(name: str, value: float, unit: str = "1", low: float = -np.inf, high: float = np.inf) -> Metric:
        return Metric(name, value, unit, low, high, decides=False)

    metrics = [
        *share_metrics("meets_all_share", [t.meets_all for t in touches], low=0.95),
        open_("meets_all_share_seen", share(seen, lambda t: t.meets_all), low=0.95),
        open_("meets_all_share_hidden", share(hidden, lambda t: t.meets_all), low=0.85),
        Metric("force_met_share", share(touches, lambda t: t.force_error <= FORCE), "1"),
        Metric("deflection_met_share", share(touches, lambda t: t.deflection_error <= DEFLECTION), "1"),
        Metric("point_met_share", share(touches, lambda t: t.point_met), "1"),
        Metric("return_met_share", share(touches, lambda t: t.return_error <= RETURN), "1"),
        open_("unanswered_share_max", max(t.unanswered for t in touches), high=judge.UNANSWERED),
        open_("joint_speed_share_max", max(t.speed_share for t in touches), high=1.0),
        open_("torque_excess_max", max(t.torque_excess for t in touches), "Nm", high=0.0),
        open_("wander_max_m", max(t.wander for t in touches), "m", high=0.05),
        open_("detection_delay_p95_s", float(np.percentile([t.delay for t in touches], 95)), "s", high=DELAY),
        Metric("trials_seen", len(seen), "1"),
        Metric("trials", len(touches), "1"),
    ]
    return [metric for metric in metrics if metric.name != "meets_all_share_hidden" or hidden]


def touch_log(touches: list[JudgedTouch]) -> Log:
    """Return the touches as a log, a row each."""
    log = Log(np.arange(len(touches), dtype=float))
    units = {"force": "N", "finger_radius": "m", "point_error": "m", "return_error": "m", "delay": "s", "wander": "m"}
    for name in JudgedTouch._fields:
        log.add(name, [getattr(touch, name) for touch in touches], units.get(name, "1"))
    log.add("meets_all", [float(touch.meets_all) for touch in touches], "1")
    return log


def failures(robot: RobotModel, touches: list[JudgedTouch], scenario: Any) -> str:
    """Return a line for each touch that does not meet all, with what replays it."""
    lines = []
    for t in touches:
        if not t.meets_all:
            lines.append(
                f"trial {t.trial}: {robot.link_names[t.link]}, {'seen' if t.seen else 'hidden'}, {t.force:.0f} N, "
                f"force {t.force_error:.0%}, deflection {t.deflection_error:.0%}, point {1e3 * t.point_error:.0f} mm, "
                f"return {1e3 * t.return_error:.1f} mm, speed {t.speed_share:.1f}, wander {1e3 * t.wander:.0f} mm "
                + again(scenario, t.trial)
            )
    return "\n".join(lines)


def touches_figure(log: Log, title: str) -> Figure:
    """Return what each touch met and missed, over the force asked of the hand."""
    result, axes = blank(2, 2, title, (9.0, 6.5))
    panels = (
        ("force_error", 1e2, "force error [%]", 1e2 * FORCE),
        ("deflection_error", 1e2, "deflection error [%]", 1e2 * DEFLECTION),
        ("point_error", 1e3, "contact point, median error [mm]", 1e3 * POINT),
        ("speed_share", 1e2, "largest joint speed [% of its limit]", 1e2),
    )
    for axis, (name, scale, label, bound) in zip(axes.ravel().tolist(), panels):
        for k, (word, marker) in enumerate((("hidden", "x"), ("seen", "o"))):
            rows = log["seen"][:, 0] == k
            axis.plot(log["force"][rows, 0], scale * log[name][rows, 0], marker, color=CYCLE[k], ms=4, label=word)
        axis.axhline(bound, color=BOUND, linestyle="--", linewidth=0.9, label="bound")
        axis.set_yscale("log")
        axis.set_xlabel("force of the push [N]")
        axis.set_ylabel(label)
    legend(axes[0, 0])
    return result
