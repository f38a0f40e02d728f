"""The cell of Section 3: a simulated robot, driven by joint velocities that a predictive controller commands."""

import time
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import Meshcat
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, EventStatus, OutputPort, State

from experiments.joint_state import feel_torque, joint_witness
from experiments.nmpc.jobs import NmpcJob
from experiments.nmpc.watch import FLOOR, ObstacleWatch, add_obstacle_watch
from saphari_drake.control.joint_servo import JointServoParameters
from saphari_drake.control.nmpc.parameters import NmpcParameters
from saphari_drake.control.nmpc.system import NmpcController
from saphari_drake.math.tree import REVOLUTE
from saphari_drake.messages import ObstaclePoints
from saphari_drake.parameters import diagonal, require_choice
from saphari_drake.pipelines.envelope import JointState, add_joint_check
from saphari_drake.pipelines.velocity import VelocityPipeline, VelocityPipelineParameters, add_velocity_pipeline
from saphari_drake.safety.joint_check.parameters import JointCheckParameters
from saphari_drake.safety.velocity_envelope.parameters import VelocityEnvelopeParameters
from saphari_drake.safety.verified_stop.parameters import VerifiedStopParameters
from saphari_drake.simulation.faults.injection import inject_into
from saphari_drake.simulation.record.recorder import Recorder
from saphari_drake.simulation.record.robot import record_robot
from saphari_drake.simulation.sensors.joint_sensor import JointSensor, JointSensorParameters
from saphari_drake.simulation.view.replay import show
from saphari_drake.simulation.world.cell import Cell, add_cell
from saphari_drake.simulation.world.floor import Floor
from saphari_drake.simulation.world.person_body import add_person_body
from saphari_drake.simulation.world.plant import PlantParameters, joint_friction
from saphari_drake.simulation.world.profile import Truth
from saphari_drake.simulation.world.references import Reference
from saphari_drake.simulation.world.true_model import true_robot
from saphari_drake.simulation.world.wheels import Wheels

Array = NDArray[np.float64]


@dataclass
class NmpcCellParameters(PlantParameters):
    """The simulated robot, its servo and its controller. The plant's step is the cycle of joint sensor and servo."""

    controller: NmpcParameters = field(default_factory=NmpcParameters)
    check: JointCheckParameters = field(default_factory=lambda: JointCheckParameters(period=0.001))
    envelope: VelocityEnvelopeParameters = field(default_factory=VelocityEnvelopeParameters)
    # What stands behind every command: "things" stops before what the obstacles are predicted to do, "people" before
    # all that people could do; "off", or a robot without shapes: nothing.
    verified_stop: str = "things"
    stop: VerifiedStopParameters = field(default_factory=VerifiedStopParameters)
    servo: JointServoParameters = field(default_factory=lambda: JointServoParameters(gain=100.0, integral_gain=2500.0))
    # How a camera sees the obstacles, if they are not told.
    watch: ObstacleWatch = field(default_factory=ObstacleWatch)

    def __post_init__(self) -> None:
        super().__post_init__()
        require_choice(self, "verified_stop", ("off", "things", "people"))


class TimedController(NmpcController):
    """A controller that notes the wall time (s) of its steps in ``seconds``, beside the Context, for the record."""

    def __init__(self, *args, **kwargs) -> None:
        super().__init__(*args, **kwargs)
        self.seconds: list[float] = []

    def _update(self, context: Context, state: State) -> EventStatus:
        start = time.perf_counter()
        status = super()._update(context, state)
        self.seconds.append(time.perf_counter() - start)
        return status


@dataclass
class NmpcCell:
    """A diagram and what is needed to run and judge it."""

    job: NmpcJob
    params: NmpcCellParameters
    cell: Cell
    controller: TimedController
    diagram: Diagram
    recorder: Recorder  # every step of the plant
    slow_recorder: Recorder  # every control period


def build_nmpc(
    job: NmpcJob,
    params: NmpcCellParameters,
    meshcat: Meshcat | None = None,
    seen: bool = False,
    truth: Truth | None = None,
) -> NmpcCell:
    """Build the diagram: sensor → controller → envelope → verified stop → servo → torques. The robot starts at home.

    Parameters
    ----------
    seen : bool
        Whether the controller gets its obstacles from a depth camera, instead of being told where they are.
    truth : Truth, optional
        How the plant differs from the robot.
    """
    robot, truth = job.robot, truth or Truth()
    builder = DiagramBuilder()
    cell = add_cell(builder, robot, [Floor(FLOOR)], params, truth)
    exact = JointSensorParameters(period=params.time_step, position_resolution=0.0, differentiate=False)
    sensor = builder.AddNamedSystem("joint_sensor", JointSensor(robot, truth.joint_sensor(exact)))
    measured = JointState(sensor.GetOutputPort("position_measured"), sensor.GetOutputPort("velocity_measured"))
    arm = bool(np.all(robot.tree.kind == REVOLUTE))  # platforms have no second encoders
    witness = joint_witness(builder, robot, cell, exact, truth) if arm else None
    checked = add_joint_check(builder, robot, measured, params.check, witness)
    known = _add_surroundings(builder, cell, job, params, checked.state.position, truth if seen else None)
    guard = {params.verified_stop: known} if params.verified_stop != "off" and params.geometry else {}
    motion = replace(params.envelope, stale_time=_stale_time(params))
    velocity = add_velocity_pipeline(
        builder, robot, checked.state, VelocityPipelineParameters(motion, params.stop, params.servo), **guard
    )
    within = acceleration_within(params.controller, velocity.envelope.bounds.acceleration)
    if truth.profile.torque_delay > 0:  # computing takes its time too
        within = replace(within, delay_compensation=True)
    controller = builder.AddNamedSystem("controller", TimedController(robot, job.end_effector, job.points, within))
    period, horizon = params.controller.period, params.controller.horizon
    reference = builder.AddNamedSystem(
        "reference", Reference({"reference": lambda time: job.horizon_reference(time, period, horizon)})
    )
    for source, target in (
        (cell.robot_state, sensor.GetInputPort("state")),
        (checked.state.position, controller.GetInputPort("position_measured")),
        (reference.get_output_port(), controller.GetInputPort("reference")),
        (known, controller.GetInputPort("obstacles")),
        (controller.GetOutputPort("velocity_commanded"), velocity.command_input),
        (velocity.torque_output, cell.torque_input),
    ):
        builder.Connect(source, target)
    if params.controller.nonholonomic:
        _add_wheels(builder, params, cell, cell.torque_driving or velocity.torque_output, truth)
    checked.close(builder, velocity.torque_output, witness)
    if witness:
        feel_torque(builder, cell, velocity.torque_output)
    recorders = _record(builder, cell, controller, velocity, known, params)
    inject_into(builder, cell, truth)
    show(builder, cell.scene_graph, meshcat)
    return NmpcCell(job, params, cell, controller, builder.Build(), *recorders)


def _add_surroundings(
    builder: DiagramBuilder,
    cell: Cell,
    job: NmpcJob,
    params: NmpcCellParameters,
    position: OutputPort,
    seen: Truth | None,
) -> OutputPort:
    """Add the obstacles; return what is known of them: all, nothing, or what a camera sees of them."""
    surroundings = builder.AddNamedSystem("surroundings", Reference({"obstacles": job.obstacles}))
    known = surroundings.get_output_port()
    if len(job.obstacles(0.0).p_WO) > 0 and np.all(job.obstacles(0.0).radius > 0.0):
        body = add_person_body(builder, cell.scene_graph, job.obstacles(0.0))
        builder.Connect(known, body.GetInputPort("obstacles"))
    if not (params.controller.obstacle_cost or params.controller.obstacle_constraints):
        nothing = builder.AddNamedSystem("no_obstacles", Reference({"obstacles": lambda t: ObstaclePoints(stamp=t)}))
        known = nothing.get_output_port()
    elif seen:
        known = add_obstacle_watch(builder, cell.scene_graph, job, params.watch, position, seen)
    return known


def _record(
    builder: DiagramBuilder,
    cell: Cell,
    controller: NmpcController,
    velocity: VelocityPipeline,
    known: OutputPort,
    params: NmpcCellParameters,
) -> tuple[Recorder, Recorder]:
    """Return what is recorded at every step of the plant, and every control period."""
    fast, slow = record_robot(builder, cell, params.time_step), Recorder(builder, params.controller.period)
    fast.add("velocity_commanded", controller.GetOutputPort("velocity_commanded"), "rad/s, m/s")
    fast.add("velocity_applied", velocity.velocity_output, "rad/s, m/s")
    if velocity.stop:
        fast.add("stop_status", velocity.stop.GetOutputPort("status"), "1")
        fast.add("stop_margin", velocity.stop.GetOutputPort("margin"), "m")
    fast.add("envelope", velocity.envelope.GetOutputPort("status"), "1")
    fast.add("torque_excess", velocity.limit.GetOutputPort("torque_excess"), "Nm, N")
    for name, unit in (("status", "1"), ("slack", "m"), ("min_clearance", "m"), ("predicted_motion", "rad, m")):
        slow.add(name, controller.GetOutputPort(name), unit)
    slow.add("obstacle_status", known, "1", lambda obstacles: [float(obstacles.status)])
    slow.add("obstacles_known", known, "m", _padded, size=4 * KNOWN)
    return fast, slow


def _stale_time(params: NmpcCellParameters) -> float:
    """Return for how long a command may be the same: where it is held, and fifty of the servo's cycles (s)."""
    held = (1.0 - params.controller.ramp) * params.controller.period
    return min(params.envelope.stale_time, held + 50 * params.envelope.period)


def acceleration_within(controller: NmpcParameters, acceleration: Array) -> NmpcParameters:
    """Return the parameters with accelerations that an envelope lets through: nine tenths of its own at most."""
    wanted = diagonal(controller.acceleration_max, len(acceleration), "acceleration_max")
    return replace(controller, acceleration_max=np.minimum(wanted, 0.9 * acceleration).tolist())


KNOWN = 48  # obstacle points that are logged, at most


def _padded(obstacles: ObstaclePoints) -> Array:
    """Obstacle points and radii (m) as one vector of fixed size, NaN where there are none."""
    rows = np.full((KNOWN, 4), np.nan)
    count = min(len(obstacles.p_WO), KNOWN)
    rows[:count, :3], rows[:count, 3] = obstacles.p_WO[:count], obstacles.radius[:count]
    return rows.ravel()


def _add_wheels(
    builder: DiagramBuilder, params: NmpcCellParameters, cell: Cell, torque: OutputPort, truth: Truth
) -> None:
    """Give the plant wheels that cannot slip sideways."""
    robot, friction = true_robot(cell.robot, truth, params.payload), joint_friction(cell.robot, params, truth)
    base, step = params.controller.nonholonomic, params.time_step
    wheels = builder.AddNamedSystem("wheels", Wheels(robot, base, step, *friction))
    builder.Connect(cell.robot_state, wheels.GetInputPort("state"))
    builder.Connect(torque, wheels.GetInputPort("torque"))
    builder.Connect(wheels.get_output_port(), cell.plant.get_applied_generalized_force_input_port())
