"""Judges a run of the impedance control: forces, deflections, and the way back."""

import numpy as np

from experiments.contact import judge
from experiments.contact.run import ContactSetup
from saphari_drake.simulation.people.recorded_push import RecordedPush
from saphari_drake.simulation.record.log import Log
from saphari_drake.simulation.runner.results import Metric


def judged(setup: ContactSetup, log: Log) -> list[Metric]:
    """Return the metrics of the contract, and those that explain them."""
    robot, case = setup.robot, setup.scenario.case
    touches = judge.find_touches(log, robot, setup.pushes)
    K_p = np.broadcast_to(setup.scenario.system.pipeline.controller.K_p, 3)
    metrics: list[Metric] = []
    if setup.recorded is not None:
        metrics += recorded_metrics(setup.recorded, setup.pushes[0].start, log)
    else:
        worst = max(judge.force_error(log, touch) for touch in touches)
        metrics.append(Metric("force_error_relative", worst, "1", high=0.10, reported="estimate used as it is"))
    metrics += judge.localization_metrics(log, touches, 0.010, 0.015)
    if setup.recorded is None:
        worst = max(judge.deflection_error(log, robot, touch, K_p) for touch in touches)
        metrics.append(Metric("deflection_error_relative", worst, "1", high=0.10, reported="F/K_p, eq. (53)"))
    delays = [judge.detection_delay(log, touch) for touch in touches]
    bound = 0.05 if case == "natural" else np.inf
    metrics.append(Metric("contact_detection_delay_s", float(np.max(delays)), "s", high=bound))
    if case == "modified":
        metrics += return_metrics(setup, log, touches)
    jump = np.abs(np.diff(log["torque"], axis=0)).max()
    metrics.append(Metric("torque_step_max_Nm", float(jump), "Nm"))
    return metrics


def return_metrics(setup: ContactSetup, log: Log, touches: list[judge.Touch]) -> list[Metric]:
    """Return the return times of the modified inertia, with the ideal ones of the same axes beside them."""
    controller = setup.scenario.system.pipeline.controller
    K_p, K_d = np.broadcast_to(controller.K_p, 3), np.broadcast_to(controller.K_d, 3)
    metrics, times, errors = [], {}, []
    for touch in touches:
        axis = int(np.argmax(np.abs(touch.push.direction)))
        name = "xyz"[axis]
        times[name] = judge.return_time(log, setup.robot, touch)
        ideal = judge.second_order_return_time(controller.M_d[axis], K_d[axis], K_p[axis])
        errors.append(abs(times[name] / ideal - 1.0))
        reported = {"x": "slowest", "y": "fastest", "z": "between"}[name]
        metrics.append(Metric(f"return_time_{name}_s", times[name], "s", 0.85 * ideal, 1.15 * ideal, reported))
    ordered = float(times["y"] < times["z"] < times["x"]) if len(times) == 3 else np.nan
    final = max(judge.position_error_final(log, setup.robot, touch) for touch in touches)
    return [
        *metrics,
        Metric("return_times_ordered", ordered, "1", 1.0, 1.0, "Y fastest, X slowest"),
        Metric("return_time_error_relative", float(np.max(errors)), "1", high=0.15),
        Metric("position_error_final_m", final, "m", high=0.002, reported="returns to the original position"),
    ]


def recorded_metrics(recorded: RecordedPush, start: float, log: Log) -> list[Metric]:
    """Return the errors along the recording, begun at `start` (s), of the whole force and of its varying part."""
    rows = log.between(start + recorded.start, start + recorded.end)
    true, estimated = log["contact_truth"][rows, :3], log["contact_force"][rows]
    size, error = np.linalg.norm, estimated - true
    varying = size(error - error.mean(axis=0)) / size(true - true.mean(axis=0))
    return [
        Metric("force_error_rms_relative", float(size(error) / size(true)), "1", high=0.15),
        Metric("force_error_rms_relative_varying", float(varying), "1"),
        Metric("force_rms_N", float(size(true) / np.sqrt(len(true))), "N"),
        Metric("force_bias_N", recorded.bias, "N"),
        Metric("force_scale", recorded.scale, "1"),
    ]
