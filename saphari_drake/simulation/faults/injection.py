"""Brings the faults of a scenario into a diagram that is wired, before it is built."""

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import DiagramBuilder, InputPort, OutputPort

from saphari_drake.perception.skin.layout import CELLS
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.faults.brakes import add_brakes
from saphari_drake.simulation.faults.registry import FAULTS
from saphari_drake.simulation.faults.signals import (
    SignalFault,
    Spoil,
    encoder,
    frozen,
    held_for,
    noisy,
    replaced,
    shifted,
)
from saphari_drake.simulation.faults.watch import add_watch
from saphari_drake.simulation.faults.wiring import insert, of_kind, readers, source_of
from saphari_drake.simulation.sensors.joint_sensor import JointSensor, MotorEncoder
from saphari_drake.simulation.sensors.joint_torque_sensor import JointTorqueSensor
from saphari_drake.simulation.world.cell import Cell
from saphari_drake.simulation.world.profile import Truth, joint_scale
from saphari_drake.simulation.world.wheels import Wheels

Array = NDArray[np.float64]
# What of a fault can be told from noise at all: of an encoder (rad or m), and of a torque (Nm or N); assumed.
ENCODER_FLOOR, TORQUE_FLOOR = 0.01, 0.6
# Who takes a controller's command, beyond the controller's own computer: of a diagram the first of these that it has.
TAKERS = (
    ("position_servo", "position_commanded"),
    ("joint_envelope", "torque_commanded"),
    ("velocity_envelope", "velocity_commanded"),
    ("joint_servo", "velocity_commanded"),
    ("arm", "velocity_commanded"),
)


def inject(
    builder: DiagramBuilder,
    robot: RobotModel,
    truth: Truth,
    torque_input: InputPort | None = None,
    encoders: OutputPort | None = None,
    state: OutputPort | None = None,
) -> None:
    """Insert the faults of `truth` that are no plant's, person's or camera's, and the watch of safe states.

    Call it when everything is wired and recorded. Without faults it does nothing.

    Parameters
    ----------
    builder : DiagramBuilder
    robot : RobotModel
    truth : Truth
    torque_input : InputPort, optional
        Where the torque enters the plant.
    encoders : OutputPort, optional
        Where positions are read, in a diagram without joint sensors.
    state : OutputPort, optional
        State of the plant's robot (2n,), whose speed the watch notes.
    """
    if not truth.faults:
        return
    for name, start in truth.faults.items():
        if FAULTS[name].part == "encoders":
            _encoders(builder, robot, truth, name, start, encoders)
        elif FAULTS[name].part == "torque" and torque_input is not None:
            _driven(builder, name, torque_input, _torque(robot, truth, name), start)
        elif FAULTS[name].part == "controller":
            length = {"controller_late": 1, "controller_late_10": 10}.get(name, np.inf) * truth.period
            _between(builder, name, _taker(builder), held_for(length), start)
        elif FAULTS[name].part in ("skin", "wrist"):
            _sensor(builder, truth, name, start)
    add_watch(builder, truth, robot, state)


def inject_into(builder: DiagramBuilder, cell: Cell, truth: Truth) -> None:
    """Insert the faults of `truth`, and the brakes that they may need, into a diagram with a cell."""
    inject(builder, cell.robot, truth, cell.torque_input, state=cell.robot_state)
    if truth.faults:  # the last before the plant: they hold whatever the drives do
        add_brakes(builder, cell)


def _between(
    builder: DiagramBuilder, name: str, target: InputPort, spoil: Spoil, start: float, floor: Array | float = 0.0
) -> None:
    source = source_of(builder, target)
    insert(builder, source, target, builder.AddNamedSystem(name, SignalFault(target.size(), spoil, start, floor)))


def _driven(builder: DiagramBuilder, name: str, target: InputPort, spoil: Spoil, start: float) -> None:
    """Of the torque, wheels and torque sensors feel what the plant gets."""
    source = source_of(builder, target)
    system = builder.AddNamedSystem(name, SignalFault(target.size(), spoil, start, TORQUE_FLOOR))
    for reader in readers(builder, source):
        if reader.get_system() is target.get_system() or isinstance(reader.get_system(), Wheels | JointTorqueSensor):
            insert(builder, source, reader, system)


def _behind(builder: DiagramBuilder, name: str, source: OutputPort, spoil: Spoil, start: float) -> None:
    system = builder.AddNamedSystem(name, SignalFault(source.size(), spoil, start))
    for target in readers(builder, source):
        insert(builder, source, target, system)


def _taker(builder: DiagramBuilder) -> InputPort:
    return next(
        builder.GetSubsystemByName(name).GetInputPort(port) for name, port in TAKERS if builder.HasSubsystemNamed(name)
    )


def _encoders(
    builder: DiagramBuilder, robot: RobotModel, truth: Truth, name: str, start: float, source: OutputPort | None
) -> None:
    sizes, joint = truth.sizes, truth.joint(robot)
    spoil = encoder(name.removeprefix("encoder_"), joint, robot.n, sizes.glitch, sizes.glitch_time)
    if source is not None:
        _behind(builder, name, source, spoil, start)
        return
    struck = (sensor for sensor in of_kind(builder, JointSensor) if not isinstance(sensor, MotorEncoder))
    floor = np.repeat([ENCODER_FLOOR, np.inf], robot.n)  # a speed that is wrong for a moment is none
    for sensor in struck:
        _between(builder, f"{name} {sensor.get_name()}", sensor.GetInputPort("state"), spoil, start, floor)


def _torque(robot: RobotModel, truth: Truth, name: str) -> Spoil:
    sizes, scale = truth.sizes, joint_scale(robot)
    if name == "torque_bias":
        return shifted(sizes.torque_bias * scale * np.random.default_rng([truth.seed, 11]).choice([-1.0, 1.0], robot.n))
    if name == "torque_noise":
        own = truth.profile.torque_noise
        return noisy(np.sqrt(max((3.0 * sizes.torque_noise) ** 2 - own**2, 0.0)) * scale, truth.seed)
    return frozen(np.array([truth.joint(robot)]))


def _sensor(builder: DiagramBuilder, truth: Truth, name: str, start: float) -> None:
    sizes = truth.sizes
    if name == "wrist_biased":
        source = builder.GetSubsystemByName("force_sensor").GetOutputPort("wrench_sensor")
        signs = np.random.default_rng([truth.seed, 12]).choice([-1.0, 1.0], 6)
        _behind(builder, name, source, shifted(signs * np.repeat([sizes.wrist_torque, sizes.wrist_force], 3)), start)
        return
    skin = builder.GetSubsystemByName("skin_sensor")
    voltages = skin.GetOutputPort("voltages")
    if name == "skin_lost":
        for port in (voltages, skin.GetOutputPort("sample_time")):
            _behind(builder, f"{name} {port.get_name()}", port, frozen(), start)
        return
    count = voltages.size() // CELLS
    dead = np.random.default_rng([truth.seed, 13]).permutation(count)[: round(sizes.skin_share * count)]
    rows = np.arange(voltages.size()).reshape(count, -1)[dead].ravel()
    _behind(builder, name, voltages, replaced(rows, 0.0), start)
