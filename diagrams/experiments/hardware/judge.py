"""What a run shows: of the touch, where the true force is known, and of the robot's cycles."""

import numpy as np
from numpy.typing import NDArray

from experiments.hardware.run import Run
from saphari_drake.simulation.runner.limits import limit_metrics
from saphari_drake.simulation.runner.results import Metric
from saphari_drake.stations.shared import StationStatus

Array = NDArray[np.float64]
TOUCHED = 0.5  # N, above which the rod touches the robot
SETTLED = 0.8  # s at the end of a push over which is averaged
LEAVING = 0.05  # s; the push is weaker before the rod leaves
GUIDED = 1.2  # s after the first touch at which the guiding velocity's window ends


def measured(run: Run) -> dict[str, float]:
    """Return the figures of the case's touch; empty where the true force is not known, or nothing was touched."""
    if run.truth is None or not np.any(run.truth[1] > TOUCHED):
        return {}
    return {"contact_impedance": _impedance, "null_space": _null_space, "hand_guiding": _guiding}[
        run.setup.scenario.case
    ](run)


def _window(run: Run, end: float | None = None) -> tuple[NDArray[np.bool_], float]:
    """Return the rows of the log in which the push is settled, before it ends, and the mean true force in them (N)."""
    time, force = run.truth or (np.zeros(0), np.zeros(0))
    touching = (force > TOUCHED) & (time < run.log.time[-1])
    end = float(time[touching][-1]) - LEAVING if end is None else end
    rows = (time >= end - SETTLED) & (time < end)
    return run.log.between(end - SETTLED, end), float(force[rows].mean())


def _direction(run: Run) -> Array:
    direction = np.asarray(run.setup.scenario.rod.direction)
    return np.asarray(direction / np.linalg.norm(direction), dtype=np.float64)


def first_touch(run: Run) -> float:
    """Return when the rod first touched the robot (s)."""
    time, force = run.truth or (np.zeros(0), np.zeros(0))
    return float(time[np.argmax(force > TOUCHED)])


def _impedance(run: Run) -> dict[str, float]:
    log, (rows, force) = run.log, _window(run)
    felt = (log["contact"][:, 0] > 0.5) & (log.time >= first_touch(run) - 0.01)
    delay = float(log.time[np.argmax(felt)]) - first_touch(run) if felt.any() else np.inf
    estimate = float((log["contact_force"][rows] @ _direction(run)).mean())
    deflection = -float((log["position_error"][rows] @ _direction(run)).mean())
    stiffness = float(np.mean(run.setup.scenario.touch.controller.K_p))
    return {
        "detection_delay_s": delay,
        "force_N": force,
        "force_error_N": abs(estimate - force),
        "deflection_m": deflection,
        "deflection_share": deflection * stiffness / force,
    }


def _null_space(run: Run) -> dict[str, float]:
    log, (rows, force) = run.log, _window(run)
    error = np.linalg.norm(log["task_error"][:, -3:], axis=1)
    robot, link = run.setup.robot, run.setup.robot.link_index(run.setup.scenario.rod.link)
    start, end = (
        robot.kinematics(q).position(link, np.asarray(run.setup.scenario.rod.aim))
        for q in (log["position_measured"][0], log["position_measured"][rows].mean(axis=0))
    )
    return {
        "force_N": force,
        "task_error_m": float(error[rows].mean()),
        "task_error_max_m": float(error[log.time >= first_touch(run)].max()),
        "body_displacement_m": float(np.linalg.norm(end - start)),
    }


def _guiding(run: Run) -> dict[str, float]:
    """Of the last stretch in which the hand pulls with its whole force."""
    log, rod, guiding = run.log, run.setup.scenario.rod, run.setup.scenario.touch.guiding
    end = first_touch(run) + GUIDED
    (rows, mean), robot = _window(run, end), run.setup.robot
    link = robot.link_index(rod.link)
    speed = []
    for q, v in zip(log["position_measured"][rows], log["velocity_measured"][rows]):
        speed.append(robot.kinematics(q, v).point(link, np.asarray(guiding.tip_point)).v_WC @ _direction(run))
    estimate = float((log["force"][rows, :3] @ _direction(run)).mean())
    damping = float(np.mean(guiding.end_effector.damping))
    return {
        "force_N": mean,
        "force_error_N": abs(estimate - mean),
        "guiding_velocity_m_s": float(np.mean(speed)),
        "guiding_velocity_share": float(np.mean(speed)) * damping / mean,
    }


def cycle_metrics(run: Run) -> list[Metric]:
    """Return what became of the cycles of a real robot."""
    c = run.cycles
    if c is None:
        return []
    ended = Metric("robot_lost", float(not c.followed.running), "1", high=0.0)
    count = max(run.log.time[-1] / run.setup.scenario.station.envelope.period, 1.0)
    metrics = [
        ended,
        Metric("station_status_max", run.log["status"].max(), "1", high=float(StationStatus.WAITING)),
        Metric("missed_share", c.missed / count, "1"),
        Metric("late_share", c.late / count, "1"),
        Metric("longest_cycle_ms", 1e3 * c.longest, "ms"),
        Metric("diagram_late_share", c.followed.late / max(c.followed.cycles, 1), "1"),
        Metric("diagram_longest_ms", 1e3 * c.followed.longest, "ms"),
    ]
    if np.isfinite(c.success):
        metrics.append(Metric("success_rate", c.success, "1", low=0.99))
    return metrics


def judged(run: Run) -> list[Metric]:
    """Return the metrics of a run, with the bounds of what the laws promise."""
    found = measured(run)
    bounds = {
        "detection_delay_s": (0.0, 0.2),
        "force_error_N": (0.0, 3.0),
        "deflection_share": (0.9, 1.1),
        "task_error_m": (0.0, 1e-3),
        "guiding_velocity_share": (0.8, 1.2),
    }
    metrics = []
    for name, value in found.items():
        unit = name.rsplit("_", 1)[-1] if name.rsplit("_", 1)[-1] in ("m", "N", "s") else "1"
        low, high = bounds.get(name, (-np.inf, np.inf))
        metrics.append(Metric(name, value, "m/s" if name.endswith("m_s") else unit, low, high))
    return [*metrics, *cycle_metrics(run), *limit_metrics(run.setup.robot, run.log["velocity_measured"], None)]
