"""Wall time of one predictive control step on one pinned thread: the mobile manipulator passing six obstacles.

Cases 1 (no obstacles), 2 (in the objective), 3 (and as constraints) and 3h (as constraints alone), 300 steps each, each
step from the shifted solution before. Peer in the same run: CasADi with IPOPT at its defaults, on the same steps,
with the distance between its velocity and ours. Then growth with obstacles and horizon, and the step as a LeafSystem.

Run: python tests/benchmarks/benchmark_nmpc.py [--no-peer] [--json FILE]
"""

import os
import sys
import time
from pathlib import Path

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[name] = "1"
if hasattr(os, "sched_setaffinity"):
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
sys.path.insert(0, str(Path(__file__).parents[1]))

import nmpc_problems as bench  # noqa: E402
import numpy as np  # noqa: E402
from bench import Timings, benchmark_options  # noqa: E402
from pydrake.common.value import AbstractValue  # noqa: E402
from pydrake.math import RigidTransform  # noqa: E402
from pydrake.systems.analysis import Simulator  # noqa: E402

from saphari_drake.control.nmpc import law  # noqa: E402
from saphari_drake.control.nmpc.law import solve  # noqa: E402
from saphari_drake.control.nmpc.system import NmpcController  # noqa: E402

LIMIT_MS = {"real_time": {"1": 0.2, "2": 0.25, "3": 0.3}, "converged": {"1": 0.6, "2": 0.7, "3": 0.8}}
OVERHEAD_MS = 0.2
AGREEMENT = 1e-3
WARM_UP = 4  # steps without a good guess, left out of the times
TIMINGS = Timings()


def row(name: str, seconds: np.ndarray, note: str = "", limit: float | None = None, peer: str | None = None) -> None:
    """Note the times, and print median, 95th percentile and maximum in ms."""
    TIMINGS.add(name.strip(), seconds, limit, peer=peer, note=note)
    ms = 1e3 * np.asarray(seconds)
    print(f"{name:38}{np.median(ms):10.3f}{np.percentile(ms, 95):10.3f}{ms.max():10.3f}  {note}", flush=True)


def verdict(seconds: np.ndarray, limit: float | None) -> str:
    """Return whether the median keeps its limit (ms)."""
    if limit is None:
        return ""
    return f"≤ {limit} ms: {'pass' if 1e3 * np.median(seconds) <= limit else 'FAIL'}; "


def run_case(case: str, mode: str, peer: bool, **changes) -> None:
    """Run the closed loop with our solver and print a row; with `peer`, one for CasADi on the same steps."""
    problem = bench.benchmark_problem(case, mode=mode, **changes)
    q, R = bench.start(problem)
    Q = np.tile(q, (problem.N, 1))
    rival = None
    if peer:
        from nmpc_peer import CasadiPeer

        rival = CasadiPeer(problem.robot, case, R)
    own, processor, theirs, iterations, differences = [], [], [], [], []
    for step in range(bench.STEPS):
        reference = bench.reference(R, bench.PERIOD * step, problem.N + 1)
        scene = problem.scene(q, reference, bench.obstacles())
        guess = np.vstack([Q[1:], Q[-1:]])
        start, on_thread = time.perf_counter(), time.thread_time()
        solution = solve(problem, scene, guess)
        own.append(time.perf_counter() - start)
        processor.append(time.thread_time() - on_thread)
        iterations.append(solution.iterations)
        if rival is not None:
            start = time.perf_counter()
            expected, ok = rival.solve(q, scene.p_ref, guess)
            theirs.append(time.perf_counter() - start)
            v = (expected[0] - q) / bench.PERIOD
            differences.append(
                np.linalg.norm((solution.Q[0] - expected[0]) / bench.PERIOD) / np.linalg.norm(v) if ok else np.inf
            )
        Q, q = solution.Q, solution.Q[0]
    times = np.array(own[WARM_UP:])
    limit = LIMIT_MS.get(mode, {}).get(case) if not changes else None
    peer_name = f"  CasADi + IPOPT, defaults, case {case}" if peer else None
    label = f"case {case}, {mode.replace('_', ' ')}" + "".join(f", {value}" for value in changes.values())
    of_thread = 1e3 * np.median(processor[WARM_UP:])
    note = (
        f"{verdict(times, limit)}thread time {of_thread:.3f}; QPs {np.mean(iterations):.1f}, at most {max(iterations)}"
    )
    row(label, times, note, limit, peer_name and peer_name.strip())
    if rival is not None:
        agree = np.mean(np.array(differences) <= AGREEMENT)
        row(peer_name, np.array(theirs[WARM_UP:]), f"same velocity within 1e-3: {agree:.1%} of steps")


def grow() -> None:
    """Print the time for more obstacles, far enough to pass, and longer horizons; case 3, 100 steps near the middle."""
    rng = np.random.default_rng(0)
    for horizon in (10, 20, 40):
        for count in (6, 60, 600):
            problem = bench.benchmark_problem("3", horizon=horizon)
            q, R = bench.start(problem)
            q[1] += 1.0
            walls = np.column_stack(
                [rng.choice([-1.2, 1.2], count), rng.uniform(0.0, 5.0, count), rng.uniform(0.0, 1.6, count)]
            )
            obstacles = bench.obstacles(np.vstack([bench.OBSTACLES, walls])[:count])
            Q, seconds = np.tile(q, (horizon, 1)), []
            for step in range(60):
                reference = bench.reference(R, 5.0 + bench.PERIOD * step, horizon + 1)
                scene, guess = problem.scene(q, reference, obstacles), np.vstack([Q[1:], Q[-1:]])
                start = time.perf_counter()
                solution = solve(problem, scene, guess)
                seconds.append(time.perf_counter() - start)
                Q, q = solution.Q, solution.Q[0]
            row(f"N_p = {horizon}, {count} obstacle points", np.array(seconds[WARM_UP:]))


def as_system(case: str) -> None:
    """Print what the LeafSystem adds to the solution: ports, checks, clearance of the applied motion, state."""
    problem = bench.benchmark_problem(case, mode="real_time")
    robot = problem.robot
    link = robot.link_names[-1]
    X_FE = RigidTransform(bench.dh_in_links(robot)[7])
    system = NmpcController(robot, link, problem.test_points, problem.params, X_FE)
    q, R = bench.start(problem)
    context = system.CreateDefaultContext()
    position = system.GetInputPort("position_measured")
    reference = system.GetInputPort("reference")
    position.FixValue(context, q)
    moving = bench.obstacles()
    simulator = Simulator(system, context)
    values, spent = [], []

    def timed(*arguments):
        start = time.perf_counter()
        solution = solve(*arguments)
        spent.append(time.perf_counter() - start)
        return solution

    law.solve = timed
    for step in range(150):
        t = bench.PERIOD * step
        seen = type(moving)(moving.p_WO, moving.v_WO, moving.radius, t)
        reference.FixValue(context, AbstractValue.Make(bench.reference(R, t, problem.N + 1)))
        system.GetInputPort("obstacles").FixValue(context, AbstractValue.Make(seen))
        position.FixValue(context, q)
        if step == 0:
            simulator.Initialize()
        start = time.perf_counter()
        simulator.AdvanceTo(t + bench.PERIOD + 2e-6)
        v = system.GetOutputPort("velocity_commanded").Eval(context)
        total = time.perf_counter() - start
        values.append(total - spent.pop())
        q = q + bench.PERIOD * v
    law.solve = solve
    row(
        f"LeafSystem beyond the solution, case {case}",
        np.array(values[WARM_UP:]),
        verdict(values, OVERHEAD_MS),
        OVERHEAD_MS,
    )


def main() -> None:
    """Print the table."""
    options = benchmark_options(__doc__, "--no-peer")
    peer = not options.no_peer
    print(f"{'one step, 10 joints, N_p = 10':38}{'median ms':>10}{'p95 ms':>10}{'max ms':>10}")
    for case in bench.CASES:
        run_case(case, "real_time", False)
        run_case(case, "converged", peer)
    run_case("3", "converged", False, solver="daqp")
    run_case("3", "converged", False, exact_hessian=False)
    for case in ("1", "3"):
        as_system(case)
    grow()
    TIMINGS.write(options.json)


if __name__ == "__main__":
    main()
