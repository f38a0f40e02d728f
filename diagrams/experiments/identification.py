"""The cell in which an arm is identified: a position servo that follows the excitation, and what judges the result."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Diagram, DiagramBuilder

from saphari_drake.estimation.excitation import Excitation, draw_excitation
from saphari_drake.estimation.joint_identification import Identification, Motion, regressor
from saphari_drake.robots.corrections import corrected
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.faults.injection import inject_into
from saphari_drake.simulation.record.log import Log
from saphari_drake.simulation.record.recorder import Recorder
from saphari_drake.simulation.record.robot import record_robot
from saphari_drake.simulation.runner.limits import limit_metrics
from saphari_drake.simulation.runner.results import Metric
from saphari_drake.simulation.sensors.joint_sensor import JointSensor
from saphari_drake.simulation.world.cell import add_cell
from saphari_drake.simulation.world.floor import Floor
from saphari_drake.simulation.world.plant import PlantParameters, joint_friction
from saphari_drake.simulation.world.position_servo import JointPositionServo
from saphari_drake.simulation.world.references import Reference
from saphari_drake.simulation.world.true_model import true_robot

Array = NDArray[np.float64]


class Recorded(NamedTuple):
    """A diagram and what is needed to run and judge it."""

    robot: RobotModel
    true: RobotModel
    friction: tuple[Array, Array]  # Coulomb and viscous, as they are
    diagram: Diagram
    recorder: Recorder


def best_excitation(scenario: Any) -> Excitation:
    """Return, of some random motions, the one whose regressor has the best conditioned scaled columns."""
    robot = scenario.loaded(scenario.home)
    rng = np.random.default_rng([scenario.seed, 20])

    def uncertainty(motion: Excitation) -> float:
        period = motion.period
        t = period + np.linspace(0.0, period, 41)
        h = 1e-4
        before, q, after = (motion.at(t + dt) for dt in (-h, 0.0, h))
        Y = regressor(robot, Motion(q, (after - before) / (2.0 * h), (after - 2.0 * q + before) / h**2))
        A = Y.reshape(-1, Y.shape[2])
        return float(np.trace(np.linalg.inv(A.T @ A + np.eye(A.shape[1]))))

    motions = [draw_excitation(robot, scenario.excitation, rng) for _ in range(scenario.excitation.trials)]
    return min(motions, key=uncertainty)


def build_identification(scenario: Any, motion: Excitation) -> Recorded:
    """Build the diagram: the motion → a position servo → torques of the plant; sensor and torque are recorded."""
    robot = scenario.loaded(scenario.home)
    truth, params = scenario.truth(scenario.servo.period), PlantParameters(payload=scenario.payload)
    builder = DiagramBuilder()
    cell = add_cell(builder, robot, [Floor()], params, truth)
    period = scenario.servo.period
    target = builder.AddNamedSystem("excitation", Reference({"value": lambda t: motion.at(t + period)}, period))
    servo = builder.AddNamedSystem("position_servo", JointPositionServo(robot, scenario.servo))
    sensor = builder.AddNamedSystem("joint_sensor", JointSensor(robot, truth.joint_sensor(scenario.joint_sensor)))
    for system in (servo, sensor):
        builder.Connect(cell.robot_state, system.GetInputPort("state"))
    builder.Connect(target.get_output_port(), servo.GetInputPort("position_commanded"))
    torque = servo.GetOutputPort("torque_commanded")
    builder.Connect(torque, cell.torque_input)
    recorder = record_robot(builder, cell, scenario.servo.period)
    recorder.add("position_measured", sensor.GetOutputPort("position_measured"), "rad")
    recorder.add("torque", torque, "Nm")
    recorder.add("torque_excess", servo.GetOutputPort("torque_excess"), "Nm")
    inject_into(builder, cell, truth)
    friction = joint_friction(robot, params, truth)
    return Recorded(robot, true_robot(robot, truth, scenario.payload), friction, builder.Build(), recorder)


def judged(scenario: Any, cell: Recorded, found: Identification, log: Log) -> list[Metric]:
    """Return how far the result is from the truth, and what it makes of the weight in random postures."""
    robot, known, rng = cell.robot, corrected(cell.robot, found.found), np.random.default_rng([scenario.seed, 21])
    postures = robot.home + rng.uniform(-1.0, 1.0, (50, robot.n))
    before, after = (np.abs([_weight(cell.true, q) - _weight(model, q) for q in postures]) for model in (robot, known))
    payload = scenario.payload + scenario.truth(1.0).profile.payload
    coulomb, viscous = cell.friction
    rotor = np.abs(known.tree.armature / np.maximum(cell.true.tree.armature, 1e-9) - 1.0)
    return [
        Metric("coulomb_error_Nm", np.abs(found.found.coulomb - coulomb).max(), "Nm", high=0.1),
        Metric("viscous_error", np.abs(found.found.viscous - viscous).max(), "Nms/rad", high=0.2),
        Metric("payload_error_kg", abs(found.found.payload - payload), "kg", high=0.2),
        Metric("rotor_error_max", rotor[cell.true.tree.armature > 0.0].max(initial=0.0), "1"),
        Metric("weight_error_before_Nm", before.max(), "Nm"),
        Metric("weight_error_Nm", after.max(), "Nm"),
        Metric("weight_error_ratio", after.max() / max(before.max(), 1e-9), "1", high=0.5),
        Metric("torque_left_before_Nm", found.before.max(), "Nm"),
        Metric("torque_left_Nm", found.after.max(), "Nm"),
        Metric("delay_found_s", found.delay, "s"),
        *limit_metrics(robot, log["velocity"], log["torque_excess"]),
    ]


def _weight(robot: RobotModel, q: Array) -> Array:
    return evaluate_dynamics(robot, q, np.zeros(robot.n)).g
