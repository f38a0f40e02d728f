"""The diagram of Section 5: cell, joint sensor, observers and null-space compliance, wired."""

from dataclasses import dataclass, field

from pydrake.systems.framework import DiagramBuilder, LeafSystem

from saphari_drake.control.null_space.parameters import NullSpaceComplianceParameters
from saphari_drake.control.null_space.system import NullSpaceComplianceController
from saphari_drake.errors import ParameterError
from saphari_drake.estimation.disturbance_observer import DisturbanceObserver, DisturbanceObserverParameters
from saphari_drake.estimation.momentum_observer import MomentumObserver, MomentumObserverParameters
from saphari_drake.robots.dynamics import RobotDynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.sensors.joint_sensor import JointSensor, JointSensorParameters
from saphari_drake.simulation.world.cell import Cell, add_cell
from saphari_drake.simulation.world.obstacles import ObstacleCellParameters

PERIOD = 0.002  # s, the cycle of the deliverable


@dataclass
class NullSpaceCellParameters:
    """World, sensor, observers and controller; the cycles must be equal."""

    cell: ObstacleCellParameters = field(default_factory=ObstacleCellParameters)
    # The arm reports position with its own velocity; the steps are those of a fine encoder. A.
    joint_sensor: JointSensorParameters = field(
        default_factory=lambda: JointSensorParameters(PERIOD, position_resolution=1e-6, differentiate=True)
    )
    # Also without the observer momentum: for the threshold, and to be compared.
    momentum: MomentumObserverParameters = field(default_factory=lambda: MomentumObserverParameters(50.0, PERIOD))
    disturbance: DisturbanceObserverParameters = field(default_factory=DisturbanceObserverParameters)
    controller: NullSpaceComplianceParameters = field(default_factory=NullSpaceComplianceParameters)

    def __post_init__(self) -> None:
        for name in ("momentum", "disturbance", "controller"):
            if getattr(self, name).period != self.joint_sensor.period:
                raise ParameterError(f"{name}.period", f"must equal joint_sensor.period, {self.joint_sensor.period} s")


@dataclass
class NullSpaceCell:
    """The parts of the diagram that others look at."""

    cell: Cell
    controller: NullSpaceComplianceController
    momentum: MomentumObserver
    disturbance: DisturbanceObserver


def add_null_space_control(
    builder: DiagramBuilder, robot: RobotModel, params: NullSpaceCellParameters
) -> tuple[JointSensor, NullSpaceComplianceController, MomentumObserver, DisturbanceObserver]:
    """Add sensor, dynamics, observers and controller, and connect them; state and torque are left to connect."""

    def add(name: str, system: LeafSystem):
        return builder.AddNamedSystem(name, system)

    sensor = add("joint_sensor", JointSensor(robot, params.joint_sensor))
    dynamics = add("dynamics", RobotDynamics(robot))
    momentum = add("momentum_observer", MomentumObserver(robot, params.momentum))
    disturbance = add("disturbance_observer", DisturbanceObserver(robot, params.disturbance))
    controller = add("controller", NullSpaceComplianceController(robot, params.controller))
    wires = (
        (sensor, "position_measured", dynamics, "position_measured"),
        (sensor, "velocity_measured", dynamics, "velocity_measured"),
        (dynamics, "dynamics", momentum, "dynamics"),
        (dynamics, "dynamics", controller, "dynamics"),
        (momentum, "residual", controller, "residual"),
        (disturbance, "torque_estimated", controller, "torque_estimated"),
        (controller, "observer_drive", disturbance, "observer_drive"),
        (controller, "yielding", disturbance, "yielding"),
        (controller, "torque_commanded", momentum, "torque_commanded"),
    )
    for source, output, target, target_port in wires:
        builder.Connect(source.GetOutputPort(output), target.GetInputPort(target_port))
    return sensor, controller, momentum, disturbance


def add_null_space_cell(
    builder: DiagramBuilder, robot: RobotModel, params: NullSpaceCellParameters | None = None
) -> NullSpaceCell:
    """Add the whole cell; the robot starts at its home posture."""
    params = params or NullSpaceCellParameters()
    cell = add_cell(builder, robot, params.cell.bodies, params.cell)
    sensor, controller, momentum, disturbance = add_null_space_control(builder, robot, params)
    builder.Connect(cell.robot_state, sensor.GetInputPort("state"))
    builder.Connect(controller.GetOutputPort("torque_commanded"), cell.torque_input)
    return NullSpaceCell(cell, controller, momentum, disturbance)
