"""The joint state at the robot's own rate, which feeds the joint envelope, and what else tells of the joints."""

from dataclasses import replace

from pydrake.systems.framework import DiagramBuilder, OutputPort

from saphari_drake.estimation.joint_velocity import JointVelocityParameters
from saphari_drake.estimation.momentum_observer import MomentumObserverParameters
from saphari_drake.pipelines.envelope import JointState, JointWitness
from saphari_drake.robots.model import RobotModel
from saphari_drake.safety.joint_envelope.parameters import JointEnvelopeParameters
from saphari_drake.simulation.sensors.joint_sensor import JointSensor, JointSensorParameters, MotorEncoder
from saphari_drake.simulation.sensors.joint_torque_sensor import JointTorqueSensor
from saphari_drake.simulation.world.cell import Cell
from saphari_drake.simulation.world.profile import Truth

# rad/s (m/s); encoders whose velocity, a difference over a period, has coarser steps are smoothed. Assumed.
COARSE = 0.002
# rad (m); step of the encoders at the motors. Assumed.
MOTOR_STEP = 1.0e-4


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


def joint_witness(
    builder: DiagramBuilder, robot: RobotModel, cell: Cell, sensor: JointSensorParameters, truth: Truth
) -> JointWitness:
    """Add encoders at the motors, sampled like `sensor`, and torque sensors, as the LWR and its like have them."""
    encoders = replace(sensor, position_resolution=MOTOR_STEP)
    motors = builder.AddNamedSystem("motor_encoder", MotorEncoder(robot, encoders))
    builder.Connect(cell.robot_state, motors.GetInputPort("state"))
    torques = builder.AddNamedSystem("torque_sensor", JointTorqueSensor(robot.n, truth.seed))
    return JointWitness(motors.GetOutputPort("position_measured"), torques.get_output_port())


def feel_torque(builder: DiagramBuilder, cell: Cell, torque: OutputPort) -> None:
    """Let the torque sensors feel the drives, which get `torque`."""
    sensor = builder.GetSubsystemByName("torque_sensor")
    builder.Connect(cell.torque_driving or torque, sensor.GetInputPort("torque"))
