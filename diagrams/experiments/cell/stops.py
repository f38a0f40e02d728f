"""Stops of a robot at full braking, over speed and posture, measured in its simulation."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram, DiagramBuilder

from saphari_drake.control.joint_servo import JointVelocityServo
from saphari_drake.math.tree import REVOLUTE
from saphari_drake.pipelines.safe_cell.parameters import SafeCellParameters
from saphari_drake.robots.dynamics import RobotDynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.safety.joint_envelope.system import JointEnvelope
from saphari_drake.safety.nearness import fastest_end, posed, surface_of
from saphari_drake.safety.speed_separation.stopping import EXTENSIONS, StoppingTable, extension_of
from saphari_drake.safety.velocity_envelope.system import VelocityEnvelope
from saphari_drake.simulation.sensors.joint_sensor import JointSensor, JointSensorParameters
from saphari_drake.simulation.world.cell import Cell, add_cell
from saphari_drake.simulation.world.plant import PlantParameters
from saphari_drake.simulation.world.profile import Truth
from saphari_drake.systems import connect

Array = NDArray[np.float64]
STEP = 0.001  # s
RISE, LONGEST = 0.4, 1.5  # s, to get to speed, and for a stop
REST = 0.01  # m/s, slower than which the robot counts as standing


class Stop(NamedTuple):
    """One stop."""

    extension: float  # share of the reach
    speed: float  # m/s, of the fastest end when the stop was asked for
    time: float  # s
    distance: float  # m, of the fastest end


class StopRig(NamedTuple):
    """A robot whose joint velocities are commanded from outside."""

    robot: RobotModel
    cell: Cell
    diagram: Diagram
    reach: float


def build_stop_rig(robot: RobotModel, truth: Truth | None = None) -> StopRig:
    """Build plant, sensor, velocity envelope, servo and joint envelope, as the safe cell has them."""
    builder, truth, own = DiagramBuilder(), truth or Truth(), SafeCellParameters()
    cell = add_cell(builder, robot, (), PlantParameters(time_step=STEP), truth)
    exact = JointSensorParameters(period=STEP, position_resolution=0.0, differentiate=False)
    sensor = builder.AddNamedSystem("joint_sensor", JointSensor(robot, truth.joint_sensor(exact)))
    dynamics = builder.AddNamedSystem("dynamics", RobotDynamics(robot))
    envelope = builder.AddNamedSystem("velocity_envelope", VelocityEnvelope(robot, own.velocity_envelope))
    servo = builder.AddNamedSystem("joint_servo", JointVelocityServo(robot, own.servo))
    exactly = replace(own.envelope, velocity_age=0.0)
    limit = builder.AddNamedSystem("joint_envelope", JointEnvelope(robot, exactly))
    builder.Connect(cell.robot_state, sensor.GetInputPort("state"))
    builder.Connect(envelope.GetOutputPort("velocity_applied"), servo.GetInputPort("velocity_commanded"))
    connect(
        builder,
        (sensor, "position_measured", dynamics, envelope, limit),
        (sensor, "velocity_measured", dynamics, limit),
        (dynamics, "dynamics", servo),
        (servo, "torque_commanded", limit),
        (limit, "torque_applied", servo),
    )
    builder.Connect(limit.GetOutputPort("torque_applied"), cell.torque_input)
    builder.ExportInput(envelope.GetInputPort("velocity_commanded"), "velocity_commanded")
    return StopRig(robot, cell, builder.Build(), reach_of(robot))


def reach_of(robot: RobotModel, postures: int = 3000) -> float:
    """Return the farthest that a shape's middle is from the first axis that turns, over random postures (m)."""
    surface, axis, rng = surface_of(robot), int(np.argmax(robot.tree.kind == REVOLUTE)), np.random.default_rng(0)
    low, high = np.maximum(robot.q_min, -np.pi), np.minimum(robot.q_max, np.pi)
    away = []
    for q in rng.uniform(low, high, (postures, robot.n)):
        at = robot.kinematics(q)
        away.append(extension_of(posed(surface, at.motion)[1], at.p_WL[axis], 1.0))
    return float(max(away))


def random_stop(rig: StopRig, rng: np.random.Generator, extension: int) -> Stop:
    """Return a stop from a random speed, in a random direction of the joints, at an extension of the given third."""
    robot, surface = rig.robot, surface_of(rig.robot)
    low, high = (np.clip(bound, -np.pi, np.pi) for bound in (robot.q_min, robot.q_max))
    axis = int(np.argmax(robot.tree.kind == REVOLUTE))
    while True:
        q = rng.uniform(0.8 * low, 0.8 * high)
        at = robot.kinematics(q)
        share = extension_of(posed(surface, at.motion)[1], at.p_WL[axis], rig.reach)
        if np.searchsorted(EXTENSIONS, share - 1e-9) == extension:
            break
    v = robot.v_max * rng.uniform(-1.0, 1.0, robot.n) * rng.uniform(0.1, 1.0) * rng.choice([0.0, 1.0], robot.n)
    simulator = Simulator(rig.diagram)
    context, plant = simulator.get_mutable_context(), rig.cell.plant
    # Half of the way there is made before the stop.
    plant.SetPositions(plant.GetMyMutableContextFromRoot(context), rig.cell.instance, q - 0.5 * RISE * v)
    command = rig.diagram.GetInputPort("velocity_commanded")
    command.FixValue(context, v)
    simulator.Initialize()
    simulator.AdvanceTo(RISE)
    command.FixValue(context, np.zeros(robot.n))
    return _measured(rig, simulator, surface, axis)


def _measured(rig: StopRig, simulator: Simulator, surface, axis: int) -> Stop:
    state = rig.cell.robot_state
    plant_context = rig.cell.plant.GetMyContextFromRoot(simulator.get_context())
    rows: list[tuple[float, float]] = []
    share = 0.0
    for k in range(int(LONGEST / STEP)):
        q, v = np.split(state.Eval(plant_context), 2)
        at = rig.robot.kinematics(q)
        share = max(share, extension_of(posed(surface, at.motion)[1], at.p_WL[axis], rig.reach)) if k == 0 else share
        rows.append((k * STEP, fastest_end(surface, at.motion, v)))
        if rows[-1][1] < REST:
            break
        simulator.AdvanceTo(RISE + (k + 1) * STEP)
    speeds = [speed for _, speed in rows]
    return Stop(share, speeds[0], rows[-1][0], STEP * float(np.sum(speeds)))


def table_of(rig: StopRig, stops: list[Stop], about: str, margin: float = 1.0, step: float = 0.25) -> StoppingTable:
    """Return the table of worst values times a margin: each node has the worst of the stops on both of its sides."""
    last = int(np.ceil(max(stop.speed for stop in stops) / step))
    nodes = step * np.arange(last + 1)
    worst = np.zeros((2, len(EXTENSIONS), last + 1))
    for stop in stops:
        k = min(int(np.searchsorted(EXTENSIONS, stop.extension - 1e-9)), len(EXTENSIONS) - 1)
        for node in (int(stop.speed / step), min(int(stop.speed / step) + 1, last)):
            worst[:, k, node] = np.maximum(worst[:, k, node], (stop.time, stop.distance))
    worst = np.maximum.accumulate(np.maximum.accumulate(worst, axis=2), axis=1)
    rounded = np.ceil(1e4 * margin * worst) / 1e4
    return StoppingTable(about, round(rig.reach, 4), nodes.tolist(), rounded[0].tolist(), rounded[1].tolist())


def share_of_table(table: StoppingTable, stop: Stop) -> tuple[float, float]:
    """Return time and distance of a stop as shares of what a table says."""
    speeds, times, distances = table.row(stop.extension)
    return stop.time / np.interp(stop.speed, speeds, times), stop.distance / np.interp(stop.speed, speeds, distances)
