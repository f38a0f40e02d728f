"""Judges a run of the force control against the simulation's own truth."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from experiments.contact.judge import Touch, steady
from saphari_drake.control.contact.gate import ForceStatus
from saphari_drake.control.contact.parameters import ContactForceControlParameters
from saphari_drake.parameters import positive_definite
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.record.log import Log

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
