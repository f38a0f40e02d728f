"""Wall time of what stands between a controller and the robot, on one pinned thread, each at 1 ms.

The joint envelope (torques, with DAQP and ProxQP on the same quadratic programs as its peers), the velocity envelope,
and the verified stop with 4 to 48 points of people around the arm, half of them near enough to matter. Commands are
such that limits are active; states lie all over the envelope.

Run: python tests/benchmarks/benchmark_safety.py [--json FILE]
"""

import os
import sys
import time
from collections.abc import Callable
from pathlib import Path

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[name] = "1"
if hasattr(os, "sched_setaffinity"):
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
sys.path.insert(0, str(Path(__file__).parents[1]))

import daqp  # noqa: E402
import numpy as np  # noqa: E402
import proxsuite  # noqa: E402
from bench import Timings, benchmark_options  # noqa: E402

from saphari_drake.robots import catalog  # noqa: E402
from saphari_drake.robots.dynamics import evaluate_dynamics  # noqa: E402
from saphari_drake.robots.model import RobotModel  # noqa: E402
from saphari_drake.safety.joint_envelope.law import Motion, limited_torque  # noqa: E402
from saphari_drake.safety.joint_envelope.parameters import JointEnvelopeParameters, envelope_of  # noqa: E402
from saphari_drake.safety.joint_envelope.stopping import acceleration_bounds  # noqa: E402
from saphari_drake.safety.velocity_envelope.law import Course, limited_velocity  # noqa: E402
from saphari_drake.safety.velocity_envelope.parameters import VelocityEnvelopeParameters, bounds_of  # noqa: E402
from saphari_drake.safety.verified_stop.law import Surroundings, checked_velocity  # noqa: E402
from saphari_drake.safety.verified_stop.parameters import VerifiedStopParameters, body_of  # noqa: E402

STEPS, WARM_UP = 4000, 50
LIMIT_MS = 0.05  # of the envelopes, in the median
STOP_P99_MS = 0.1


def main() -> None:
    """Print and note the rows."""
    options, timings = benchmark_options(__doc__), Timings()
    print(f"{'':38}{'median':>10}{'p95':>10}{'p99':>10}  ms")

    def row(
        name: str, seconds: np.ndarray, aimed_ms: float | None = None, peer: str | None = None, note: str = ""
    ) -> None:
        timings.add(name, seconds, aimed_ms, peer=peer, note=note)
        print(f"{name:38}" + "".join(f"{1e3 * np.percentile(seconds, s):10.4f}" for s in (50, 95, 99)) + f"  {note}")

    arm, platform = catalog.lwr4(), catalog.omnirob()
    own, daqp_seconds, proxqp_seconds = torque_envelope(arm)
    row("joint envelope, 7 joints", own, LIMIT_MS, "joint envelope, DAQP")
    row("joint envelope, DAQP", daqp_seconds, note="the quadratic program alone")
    row("joint envelope, ProxQP", proxqp_seconds, note="the quadratic program alone")
    for robot in (arm, platform):
        row(f"velocity envelope, {robot.n} joints", velocity_envelope(robot), LIMIT_MS)
    for robot, count in ((arm, 4), (arm, 16), (arm, 48), (platform, 16)):
        seconds = verified_stop(robot, count)
        told = f"p99 ≤ {STOP_P99_MS} ms: {'pass' if 1e3 * np.percentile(seconds, 99) <= STOP_P99_MS else 'FAIL'}"
        row(f"verified stop, {robot.n} joints, {count} points", seconds, note=told)
    timings.write(options.json)


def timed(step: Callable[[], object]) -> float:
    """Return the wall time (s) of one step."""
    start = time.perf_counter()
    step()
    return time.perf_counter() - start


def states(robot: RobotModel, seed: int):
    """Return random positions and velocities."""
    rng = np.random.default_rng(seed)
    low, high = np.maximum(robot.q_min, -2.0), np.minimum(robot.q_max, 2.0)
    for _ in range(STEPS):
        yield rng, rng.uniform(low, high), 0.5 * robot.v_max * rng.uniform(-1.0, 1.0, robot.n)


def torque_envelope(robot: RobotModel) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the times of the torque envelope, and of DAQP and ProxQP for its quadratic program."""
    e, n, own, peer, other = envelope_of(robot, JointEnvelopeParameters()), robot.n, [], [], []
    proxqp = proxsuite.proxqp.dense.QP(n, 0, 2 * n)
    proxqp.init(np.eye(n), np.zeros(n), None, None, np.zeros((2 * n, n)), -np.ones(2 * n), np.ones(2 * n))
    low, high, sense = np.empty(2 * n), np.empty(2 * n), np.zeros(2 * n, dtype=np.int32)
    for rng, q, v in states(robot, 0):
        terms = evaluate_dynamics(robot, q, v)
        h, command = terms.Cv + terms.g, rng.uniform(-2.0, 2.0, n) * robot.tau_max
        motion = Motion(q, v, terms.M, h, np.zeros(n), terms.g)
        own.append(timed(lambda motion=motion, command=command: limited_torque(e, motion, command)))
        acceleration_bounds(q, v, e.q_min, e.q_max, e.v_max, e.deceleration, e.jerk, e.period, low, high)
        low[n:] = np.maximum(-e.tau_max, terms.g - e.tau_rate * e.period) - h
        high[n:] = np.minimum(e.tau_max, terms.g + e.tau_rate * e.period) - h
        f, C = h - command, np.ascontiguousarray(np.vstack([np.eye(n), terms.M]))
        peer.append(timed(lambda f=f, C=C, terms=terms: daqp.solve(terms.M, f, C, high, low, sense)))

        def solve(f=f, C=C, terms=terms) -> None:
            proxqp.update(H=terms.M, g=f, C=C, l=low, u=high)
            proxqp.solve()

        other.append(timed(solve))
    return np.array(own[WARM_UP:]), np.array(peer[WARM_UP:]), np.array(other[WARM_UP:])


def velocity_envelope(robot: RobotModel) -> np.ndarray:
    """Return the times of the velocity envelope, along courses that are commanded at random."""
    bounds, n, seconds = bounds_of(robot, VelocityEnvelopeParameters()), robot.n, []
    course = Course(robot.home, np.zeros(n), np.zeros(n))
    command = np.zeros(n)
    for k, (rng, _, _) in enumerate(states(robot, 1)):
        command = 2.0 * robot.v_max * rng.normal(size=n) if k % 50 == 0 else command
        given = bounds, course, course.q, command
        seconds.append(timed(lambda given=given: limited_velocity(*given)))
        course = limited_velocity(*given).course
    return np.array(seconds[WARM_UP:])


def verified_stop(robot: RobotModel, count: int) -> np.ndarray:
    """Return the times of the stop check, with a person somewhere around the end effector."""
    params, seconds = VerifiedStopParameters(), []
    body, still = body_of(robot, params), np.zeros((count, 3))
    for rng, q, v in states(robot, 2):
        centre = robot.kinematics(q).p_WL[-1] + 0.7 * rng.normal(size=3)
        p = centre + 0.15 * rng.normal(size=(count, 3))
        around = Surroundings(p, still, np.full(count, 0.08), np.full(count, params.person_speed))
        given = body, params.intervals, q, v, v + 0.01 * rng.normal(size=robot.n), True, around
        seconds.append(timed(lambda given=given: checked_velocity(*given)))
    return np.array(seconds[WARM_UP:])


if __name__ == "__main__":
    main()
