"""Time of one 2 ms cycle of the null-space compliance: sensor, dynamics, observer and controller, on one thread.

Wall time, and time of the thread alone, which other programs on the machine disturb less.

Run: python tests/benchmarks/benchmark_null_space.py [--json FILE]
"""

import os
import sys
import time
from pathlib import Path

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[name] = "1"
sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np  # noqa: E402
from bench import Timings, benchmark_options  # noqa: E402
from pydrake.systems.analysis import Simulator  # noqa: E402
from pydrake.systems.framework import DiagramBuilder  # noqa: E402

from saphari_drake.pipelines.null_space import NullSpacePipelineParameters, add_null_space_pipeline  # noqa: E402
from saphari_drake.robots.catalog import lwr4  # noqa: E402
from saphari_drake.simulation.sensors.joint_sensor import JointSensor, JointSensorParameters  # noqa: E402

CYCLES, WARM_UP = 1200, 100
LIMIT_MS = 0.2


def main() -> None:
    """Print the times of whole cycles and of controller with observer alone, for every observer and task."""
    options, timings = benchmark_options(__doc__), Timings()
    print(f"{'':26}{'whole cycle, ms':>28}{'controller + observer, ms':>34}")
    print(f"{'observer':16}{'task':10}" + f"{'wall':>12}{'p95':>8}{'thread':>8}{'':6}" * 2)
    for task in ("position", "pose"):
        for observer in ("none", "task_error", "task_error_pd", "momentum"):
            whole, own = cycles(observer, task)
            timings.add(f"whole cycle, {observer}, {task}", 1e-3 * whole[0], LIMIT_MS)
            timings.add(f"controller and observer, {observer}, {task}", 1e-3 * own[0])
            cells = [
                f"{np.median(wall):12.3f}{np.percentile(wall, 95):8.3f}{np.median(thread):8.3f}{'':6}"
                for wall, thread in (whole, own)
            ]
            print(f"{observer:16}{task:10}{''.join(cells)}")
    timings.write(options.json)


def now() -> np.ndarray:
    """Return wall and thread time (ms)."""
    return 1e3 * np.array([time.perf_counter(), time.thread_time()])


def cycles(observer: str, task: str) -> tuple[np.ndarray, np.ndarray]:
    """Return wall and thread times (2, cycles) in ms of all systems with the event loop, and of what follows M(q)."""
    params = NullSpacePipelineParameters()
    params.controller.observer, params.controller.task, params.controller.gamma = observer, task, 0.02
    robot, builder = lwr4(), DiagramBuilder()
    sensor = builder.AddSystem(JointSensor(robot, JointSensorParameters(params.period, 1e-6)))
    pipeline = add_null_space_pipeline(builder, robot, sensor.get_output_port(0), sensor.get_output_port(1), params)
    builder.ExportInput(sensor.GetInputPort("state"), "state")
    builder.ExportOutput(pipeline.torque_output, "torque")
    diagram = builder.Build()
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    state, torque, rng = diagram.get_input_port(0), diagram.get_output_port(0), np.random.default_rng(0)
    state.FixValue(context, np.concatenate([robot.home, np.zeros(robot.n)]))
    simulator.Initialize()
    dynamics = diagram.GetSubsystemByName("dynamics")
    own_context = dynamics.GetMyContextFromRoot(context)
    whole, own = np.zeros((2, CYCLES)), np.zeros((2, CYCLES))
    for k in range(CYCLES):
        q = robot.home + 0.05 * np.sin(2e-3 * k + np.arange(robot.n)) + 1e-6 * rng.normal(size=robot.n)
        state.FixValue(context, np.concatenate([q, np.zeros(robot.n)]))
        start = now()
        simulator.AdvanceTo((k + 1.5) * params.period)
        dynamics.GetOutputPort("dynamics").Eval(own_context)
        middle = now()
        torque.Eval(context)
        end = now()
        whole[:, k], own[:, k] = end - start, end - middle
    return whole[:, WARM_UP:], own[:, WARM_UP:]


if __name__ == "__main__":
    main()
