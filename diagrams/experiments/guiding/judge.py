"""Judges a run of the guiding cell against the simulation's own truth."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from experiments.guiding.run import GuidingRun
from experiments.guiding.touches import SkinTouch, skin_touches
from saphari_drake.control.hand_guiding.parameters import HandGuidingParameters
from saphari_drake.math.guided_motion import admittance, admittance_matrices, task_inverse
from saphari_drake.parameters import positive_definite
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.runner.results import NothingToJudgeError

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
SETTLING = 0.3  # s after a touch begins, in which its law is still faded in
WINDOW = 0.05  # s over which accelerations are averaged


def true_force(run: GuidingRun, hand: int) -> Array:
    """Return the force of a hand (0: end effector, 1: body) on the robot (T, 3), N, world."""
    return run.log["truth"][:, 9 * hand : 9 * hand + 3]


def true_velocity(run: GuidingRun, hand: int) -> Array:
    """Return the velocity of the point that a hand holds (T, 3), m/s, world."""
    return run.log["truth"][:, 9 * hand + 6 : 9 * hand + 9]


def main_touched(run: GuidingRun) -> Mask:
    """Return when the first hand's point is the main task (T,)."""
    return run.log["priority"][:, 0] == run.setup.scenario.main + 1


def second_phase(run: GuidingRun) -> Mask:
    """Return from when the second hand presses until the first one's force falls below `touch_off` for good (T,).

    Raises
    ------
    NothingToJudgeError
        If there is no such time.
    """
    main = run.setup.scenario.main
    pressed = np.linalg.norm(true_force(run, 1 - main), axis=1) > 0.5
    both = np.flatnonzero(pressed & main_touched(run))
    if len(both) == 0:
        raise NothingToJudgeError("the second hand does not touch while the first one does")
    params: HandGuidingParameters = run.setup.scenario.system.pipeline.controller
    held = np.flatnonzero(
        np.linalg.norm(true_force(run, main), axis=1) >= (params.end_effector, params.body)[main].touch_off
    )
    rows = np.arange(len(pressed))
    return (rows >= both[0]) & (rows <= held[-1])


def main_task_disturbance(run: GuidingRun, alone: GuidingRun) -> float:
    """Return max ‖ṗ − ṗ_alone‖ / max ‖ṗ_alone‖ of the main point once the second hand presses.

    Parameters
    ----------
    run, alone : GuidingRun
        With the second hand, and the same without it.
    """
    rows, main = second_phase(run), run.setup.scenario.main
    v, v_alone = true_velocity(run, main), true_velocity(alone, main)
    difference = np.linalg.norm((v - v_alone)[rows], axis=1).max()
    return float(difference / np.linalg.norm(v_alone, axis=1).max())


def touches_of(run: GuidingRun) -> list[SkinTouch]:
    """Return what the skin says of each touch of the body."""
    point, grip = run.setup.scenario.system.pipeline.controller.body, run.setup.grips[1]
    estimated, p_LC = run.log["force"][:, 3:], np.asarray(grip.p_LC, dtype=float)
    return skin_touches(true_force(run, 1), estimated, run.log["skin"], p_LC, point.touch_on, point.touch_off)


def secondary_realised(run: GuidingRun) -> float:
    """Return how much of the second point's commanded acceleration the plant realises: the slope of a regression.

    Means over 50 ms: single cycles hold the noise of the wrist sensor, which moves the arm before it is felt. Both are
    projected on the directions in which the second point can move without the main one, at singular values
    above the threshold. Left out is what is left out of the law there: the time after a touch begins, while changes
    fade in, and cycles in which joint limits hold the arm back.
    """
    log, main = run.log, run.setup.scenario.main
    second, params = 1 - main, run.setup.scenario.system.pipeline.controller
    dt = float(log.time[1] - log.time[0])
    v = true_velocity(run, second)
    realised = np.vstack([np.zeros(3), np.diff(v, axis=0) / dt])
    # What is logged at a cycle's nominal time was commanded in the cycle that ends there.
    asked = log["acceleration_desired"][:, 3 * second : 3 * second + 3]
    touched = main_touched(run) & np.any(asked != 0.0, axis=1)
    begins = np.flatnonzero(np.diff(touched.astype(int), prepend=0) == 1)
    for start in begins:
        touched[start : start + int(SETTLING / dt)] = False
    touched &= ~held_back(run)
    if not np.any(touched):
        return float("nan")
    above, below, length = 0.0, 0.0, round(WINDOW / dt)
    kernel = np.full(length, 1.0 / length)
    whole = np.convolve(touched, kernel, "same") > 1.0 - 1e-9
    realised, asked = (np.column_stack([np.convolve(x, kernel, "same") for x in a.T]) for a in (realised, asked))
    for k in np.flatnonzero(whole)[::5]:
        R = _reachable(run, int(k), main, params.damping_threshold)
        above += float(asked[k] @ R @ realised[k])
        below += float(asked[k] @ R @ asked[k])
    return above / below if below > 0.0 else float("nan")


def held_back(run: GuidingRun) -> Mask:
    """Return when a joint is within 0.05 rad of the bounds that the controller keeps, or near its speed limit (T,)."""
    params = run.setup.scenario.system.pipeline.controller
    return near_limits(run.setup.robot, params, run.log["position"], run.log["velocity"])


def near_limits(robot: RobotModel, params: HandGuidingParameters, q: Array, v: Array) -> Mask:
    """Return when a joint is so near to its bounds, for positions (rad or m) and velocities (T, n)."""
    margin = params.joint_margin + 0.05
    near = (q < robot.q_min + margin) | (q > robot.q_max - margin)
    fast = np.abs(v) > 0.97 * params.joint_speed_share * robot.v_max
    approaching = (robot.q_max - q < 1.05 * params.approach_time * v) | (
        q - robot.q_min < -1.05 * params.approach_time * v
    )
    return np.asarray(np.any(near | fast | approaching, axis=1))


def _reachable(run: GuidingRun, row: int, main: int, threshold: float) -> Array:
    """Return the projector on the directions of the second point that the law realises exactly (3, 3)."""
    terms = evaluate_dynamics(run.setup.robot, run.log["position"][row], run.log["velocity"][row])
    J = [terms.point(grip.link, np.asarray(grip.p_LC, dtype=float)).Jv_WC for grip in run.setup.grips]
    J_inv, *_ = task_inverse(J[main], threshold)
    free = J[1 - main] @ (np.eye(run.setup.robot.n) - J_inv @ J[main])
    U, sigma, _ = np.linalg.svd(free)
    kept = U[:, sigma >= threshold]
    return np.asarray(kept @ kept.T)


def ideal_velocity(run: GuidingRun) -> Array:
    """Return ṗ_d (T, 3) that (48) gives the main point for the true force while it is touched, m/s."""
    params: HandGuidingParameters = run.setup.scenario.system.pipeline.controller
    main = run.setup.scenario.main
    point = (params.end_effector, params.body)[main]
    mass, damping = positive_definite(point.mass, 3, "mass"), positive_definite(point.damping, 3, "damping")
    dt = float(run.log.time[1] - run.log.time[0])
    matrices = admittance_matrices(mass, damping, dt)
    force, touched = true_force(run, main), main_touched(run)
    v, path = np.zeros(3), np.zeros_like(force)
    for k in range(1, len(path)):
        v = admittance(v, force[k - 1].copy(), *matrices, point.max_speed)[0] if touched[k] else np.zeros(3)
        path[k] = v
    return path


def velocity_error(run: GuidingRun) -> float:
    """Return the rms difference of the main point's velocity from `ideal_velocity`, over its rms."""
    rows, ideal = main_touched(run), ideal_velocity(run)
    error = true_velocity(run, run.setup.scenario.main) - ideal
    # The skin's point has no ideal motion along the direction in which it cannot move.
    if run.setup.scenario.main == 1:
        for k in np.flatnonzero(rows):
            terms = evaluate_dynamics(run.setup.robot, run.log["position"][k], run.log["velocity"][k])
            grip = run.setup.grips[1]
            J = terms.point(grip.link, np.asarray(grip.p_LC, dtype=float)).Jv_WC
            error[k] = task_inverse(J, run.setup.scenario.system.pipeline.controller.damping_threshold)[1] @ error[k]
    return float(np.sqrt(np.sum(error[rows] ** 2) / np.sum(ideal[rows] ** 2)))


def torque_step(run: GuidingRun) -> float:
    """Return the largest change of a joint torque from one cycle to the next (Nm), after the first ten cycles."""
    return float(np.abs(np.diff(run.log["torque_commanded"][10:], axis=0)).max())
