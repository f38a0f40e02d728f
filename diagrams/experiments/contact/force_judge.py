"""Judges a run of the force control against the simulation's own truth."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from experiments.contact.judge import Touch, find_touches, localization_metrics, steady
from experiments.contact.run import ContactSetup
from saphari_drake.control.contact.gate import ForceStatus
from saphari_drake.control.contact.parameters import ContactForceControlParameters
from saphari_drake.control.contact.stability import hand_stiffness_limits
from saphari_drake.parameters import positive_definite
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.record.log import Log
from saphari_drake.simulation.runner.results import Metric

Array = NDArray[np.float64]
REST = 0.3  # s after a release from which on the robot has to be at rest
CONTROLLED = (ForceStatus.CONTROLLED, ForceStatus.PARTIAL)


def observable(log: Log, rows: NDArray[np.intp]) -> Array:
    """Return the part (k, 3) of the true force that joint torques show, as the estimator sees it (N)."""
    hidden = log["unobservable"][rows].reshape(-1, 3, 3)  # a direction a row
    force = log["contact_truth"][rows, :3]
    return np.asarray(force - np.einsum("kdi,kdj,kj->ki", hidden, hidden, force))


def steady_norms(log: Log, touch: Touch) -> tuple[float, float, float]:
    """Return the mean size in the steady part of the observable true force, the whole one, and the estimate (N)."""
    rows = steady(log, touch)
    forces = observable(log, rows), log["contact_truth"][rows, :3], log["contact_force"][rows]
    shown, whole, estimated = (float(np.linalg.norm(force, axis=1).mean()) for force in forces)
    return shown, whole, estimated


def true_velocity(log: Log, robot: RobotModel) -> Array:
    """Return the velocity (T, 3) of the controlled contact point from the plant's state; zero without one (m/s)."""
    velocity = np.zeros((len(log.time), 3))
    for i in np.flatnonzero(log["active_link"][:, 0] >= 0):
        terms = evaluate_dynamics(robot, log["position"][i], log["velocity"][i])
        link = int(log["active_link"][i, 0])
        p_LC = terms.in_link(link, log["contact_position"][i])
        velocity[i] = terms.point(link, p_LC).v_WC
    return velocity


def untouched(log: Log) -> list[NDArray[np.intp]]:
    """Return the samples of each interval without contact force, from `REST` after the release on."""
    touched = np.linalg.norm(log["contact_truth"][:, :3], axis=1) > 0.0
    edges = np.flatnonzero(np.diff(np.concatenate(([True], touched, [True])).astype(int)))
    parts = []
    for first, last in zip(edges[::2], edges[1::2]):
        begin = log.time[first] + (REST if first > 0 else 0.0)
        rows = np.arange(first, last)
        parts.append(rows[log.time[rows] >= begin])
    return [rows for rows in parts if len(rows) > 1]


def motion(log: Log, robot: RobotModel, rows: NDArray[np.intp]) -> float:
    """Return the largest distance (m) that any link's frame, or the tip, goes from where it was at the first row."""
    tip = np.array([0.0, 0.0, 0.1])

    def points(q: Array) -> Array:
        terms = evaluate_dynamics(robot, q, np.zeros(robot.n))
        return np.vstack([terms.p_WL, terms.p_WL[-1] + terms.R_WL[-1] @ tip])

    start = points(log["position"][rows[0]])
    return max(float(np.linalg.norm(points(log["position"][i]) - start, axis=1).max()) for i in rows[::5])


class Drift(NamedTuple):
    """A drift along the fixed desired force, from the opening of the gate to the speed stop."""

    rows: NDArray[np.intp]  # samples
    velocity: Array  # (T, 3) m/s, of the contact
    stopped: bool


def find_drift(log: Log, robot: RobotModel, touch: Touch) -> Drift:
    """Return the drift of a touch that a speed stop ended, or the last one of it."""
    status = log["force_status"][:, 0]
    inside = np.arange(touch.onset, touch.release + 1)
    stops = inside[status[inside] == ForceStatus.SPEED_STOP]
    end = int(stops[0]) if len(stops) else touch.release
    controlled = np.isin(status, CONTROLLED)
    last = int(np.flatnonzero(controlled[:end])[-1])
    closed = np.flatnonzero(~controlled[:last])
    rows = np.arange(int(closed[-1]) + 1, last + 1)
    return Drift(rows, true_velocity(log, robot)[rows], bool(len(stops)))


def free_drift_speed(F_d: float, K_f: float, K_d: float, mass: float, time: Array) -> Array:
    """Return (K_f F_d/K_d)(1 − e^{−K_d t/M}), the speed (m/s) that eq. (60) gives where nobody resists F_d (N)."""
    return np.asarray(K_f * F_d / K_d * -np.expm1(-K_d * time / mass))


def expected_drift(log: Log, robot: RobotModel, drift: Drift, params: ContactForceControlParameters) -> Array:
    """Return the velocity (3,) at the end of a drift that eq. (60) gives with the estimated force (m/s).

    The torque that continues the law before and fades out is taken from the run, and so is what the person gives and
    the estimate lacks; both act on the natural inertia.
    """
    K_f, K_d = np.diag(np.broadcast_to(params.K_f, 3)), np.diag(np.broadcast_to(params.K_d, 3))
    v = drift.velocity[0]
    for k, row in enumerate(drift.rows[:-1]):
        terms = evaluate_dynamics(robot, log["position"][row], log["velocity"][row])
        link = int(log["active_link"][row, 0])
        J = terms.point(link, terms.in_link(link, log["contact_position"][row])).Jv_WC
        M_inv_JT = np.linalg.solve(terms.M, J.T)
        mobility = J @ M_inv_JT
        M_d_inv = np.linalg.inv(positive_definite(params.M_d, 3, "M_d")) if len(params.M_d) else mobility
        F, estimate = log["contact_truth"][row, :3], log["contact_force"][row]
        wanted = K_f @ (estimate - params.fixed_force) - K_d @ v
        beside = mobility @ (F - estimate) + M_inv_JT.T @ log["transition"][row]
        v = v + (log.time[drift.rows[k + 1]] - log.time[row]) * (M_d_inv @ wanted + beside)
    return np.asarray(v)


def judged(setup: ContactSetup, log: Log) -> list[Metric]:
    """Return the metrics of the contract, and those that explain them."""
    robot, pipeline = setup.robot, setup.scenario.system.pipeline
    control, K_I = pipeline.controller, float(np.min(pipeline.observer.bandwidth))
    touches = find_touches(log, robot, setup.pushes)
    speed = np.linalg.norm(true_velocity(log, robot), axis=1)
    metrics = (
        drift_metrics(setup, log, touches)
        if control.direction == "fixed"
        else force_metrics(log, touches, control.desired_force)
    )
    still = max(motion(log, robot, rows) for rows in untouched(log))
    jump = np.abs(np.diff(log["torque"], axis=0)).max()
    return [
        *metrics,
        Metric("motion_without_touch_m", still, "m", high=0.001, reported="at rest"),
        Metric("max_speed", float(speed.max()), "m/s", high=control.speed_limit),
        # Below the stated stiffness of the hand, force control can oscillate with it, and a warning says so.
        Metric(
            "hand_stiffness_limit",
            float(hand_stiffness_limits(control, K_I).min()),
            "N/m",
            low=control.hand_stiffness,
            decides=False,
        ),
        # A push that grows slowly where its lever is short is felt late: the detector's threshold is 1 Nm.
        *localization_metrics(log, touches, answered=False),
        Metric("torque_step_max_Nm", float(jump), "Nm"),
    ]


def force_metrics(log: Log, touches: list[Touch], desired: float) -> list[Metric]:
    """Return the error of the contact force's size (N), and the size in each touch.

    On links 1 to 3 joint torques show a part of the force alone. That part is controlled, and decides; the whole force
    stands beside it.
    """
    metrics, errors, whole_errors = [], [], []
    for touch in touches:
        shown, whole, estimated = steady_norms(log, touch)
        errors.append(abs(shown - desired))
        whole_errors.append(abs(whole - desired))
        name = touch.push.link
        metrics.append(Metric(f"force_norm_{name}_N", shown, "N", reported="15 N"))
        if abs(whole - shown) > 0.01:
            metrics.append(Metric(f"force_norm_{name}_with_unobservable_N", whole, "N"))
        metrics.append(Metric(f"force_estimate_norm_{name}_N", estimated, "N"))
    return [
        Metric("force_norm_error_N", float(np.max(errors)), "N", high=0.5, reported="about 1 N"),
        Metric("force_norm_error_whole_N", float(np.max(whole_errors)), "N", high=0.5, decides=False),
        *metrics,
    ]


def drift_metrics(setup: ContactSetup, log: Log, touches: list[Touch]) -> list[Metric]:
    """Return the error of the force that is resisted, and the drift along the one that is not, if it came."""
    control = setup.scenario.system.pipeline.controller
    wanted = np.array(control.fixed_force)
    unit, size = wanted / np.linalg.norm(wanted), float(np.linalg.norm(wanted))
    rows = steady(log, touches[0])
    held = float((log["contact_truth"][rows, :3] @ unit).mean())
    resisted = Metric("force_along_desired_error_N", abs(held - size), "N", high=0.5, reported="regulated")
    if len(touches) < 2:
        return [resisted]
    drift = find_drift(log, setup.robot, touches[1])
    velocity, expected = drift.velocity[-1], expected_drift(log, setup.robot, drift, control)
    time = float(log.time[drift.rows[-1]] - log.time[drift.rows[0]])
    axis = int(np.argmax(np.abs(unit)))
    K_f, K_d = np.broadcast_to(control.K_f, 3)[axis], np.broadcast_to(control.K_d, 3)[axis]
    cosine = velocity @ expected / (np.linalg.norm(velocity) * np.linalg.norm(expected))
    metrics = [
        resisted,
        Metric("drift_speed", -velocity @ unit, "m/s", low=0.0, reported="drifts against F_d"),
        Metric("drift_speed_expected", -expected @ unit, "m/s"),
        Metric("drift_speed_error_relative", abs((velocity @ unit) / (expected @ unit) - 1.0), "1", high=0.1),
        Metric("drift_direction_error_rad", float(np.arccos(min(cosine, 1.0))), "rad", high=0.2),
        Metric("drift_time_s", time, "s"),
        Metric("drift_stopped", float(drift.stopped), "1", 1.0, 1.0),
    ]
    if len(control.M_d):
        free = free_drift_speed(size, K_f, K_d, control.M_d[axis], np.array(time))
        metrics.append(Metric("drift_speed_without_transition", float(free), "m/s"))
    return metrics
