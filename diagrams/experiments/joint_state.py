"""The joint state at the robot's own rate, which feeds the joint envelope."""

from dataclasses import replace

from pydrake.systems.framework import DiagramBuilder

from saphari_drake.estimation.joint_velocity import JointVelocityParameters
from saphari_drake.estimation.momentum_observer import MomentumObserverParameters
from saphari_drake.pipelines.envelope import JointState
from saphari_drake.robots.model import RobotModel
from saphari_drake.safety.joint_envelope.parameters import JointEnvelopeParameters
from saphari_drake.simulation.sensors.joint_sensor import JointSensor, JointSensorParameters
from saphari_drake.simulation.world.cell import Cell
from saphari_drake.simulation.world.profile import Truth

# rad/s (m/s); encoders whose velocity, a difference over a period, has coarser steps are smoothed. Assumed.
COARSE = 0.002


def own_joint_state(
    builder: DiagramBuilder,
    robot: RobotModel,
    cell: Cell,
    sensor: JointSensorParameters,
    params: JointEnvelopeParameters,
    observer: MomentumObserverParameters,
    truth: Truth,
    velocity: JointVelocityParameters | None = None,
) -> JointState:
    """Add a joint sensor like `sensor` with the period of the envelope.

    Envelope and observer are told how late velocities are, and how late the torque acts: both are known. With
    `velocity`, which is told the step of coarse encoders, velocities are not late any more.
    """
    sensor = replace(truth.joint_sensor(sensor), period=params.period)
    late = sensor.differentiate
    if velocity and sensor.differentiate and sensor.position_resolution > COARSE * params.period:
        velocity.resolution, late = sensor.position_resolution, False
    params.velocity_age = 0.5 * params.period if late else 0.0
    observer.velocity_delay = 0.5 if late else 0.0
    params.torque_delay = truth.profile.torque_delay * truth.period
    system = builder.AddNamedSystem("envelope_sensor", JointSensor(robot, sensor))
    builder.Connect(cell.robot_state, system.GetInputPort("state"))
    return JointState(system.GetOutputPort("position_measured"), system.GetOutputPort("velocity_measured"))
