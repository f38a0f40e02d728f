"""The cell of Section 3: a simulated robot, driven by joint velocities that a predictive controller commands."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.geometry import CollisionFilterDeclaration, GeometrySet, Meshcat, MeshcatVisualizer, SceneGraph
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, EventStatus, LeafSystem, OutputPort, State
from pydrake.systems.primitives import MatrixGain

from experiments.nmpc.jobs import NmpcJob
from experiments.nmpc.watch import FLOOR, ObstacleWatch, add_obstacle_watch
from saphari_drake.control.joint_servo import JointServoParameters, JointVelocityServo
from saphari_drake.control.nmpc.parameters import NmpcParameters
from saphari_drake.control.nmpc.system import NmpcController
from saphari_drake.messages import ObstaclePoints
from saphari_drake.parameters import require_positive
from saphari_drake.robots.dynamics import RobotDynamics
from saphari_drake.simulation.record.recorder import Recorder
from saphari_drake.simulation.sensors.joint_sensor import JointSensor, JointSensorParameters
from saphari_drake.simulation.world.hand_and_floor import add_floor
from saphari_drake.simulation.world.person_body import add_person_body
from saphari_drake.simulation.world.wheels import Wheels

Array = NDArray[np.float64]


@dataclass
class NmpcCellParameters:
    """The simulated robot, its servo and its controller."""

    # s; step of the discrete plant, and cycle of joint sensor and servo.
    time_step: float = 0.001
    controller: NmpcParameters = field(default_factory=NmpcParameters)
    # Commands are steps, held over a control period: fed forward they would be impulses.
    servo: JointServoParameters = field(default_factory=lambda: JointServoParameters(gain=100.0, feedforward=0.0))
    # Whether the robot's shapes are loaded; without them it runs the same and is shown by its test points alone. For
    # model files whose meshes cannot be found.
    geometry: bool = True
    # How a camera sees the obstacles, if they are not told.
    watch: ObstacleWatch = field(default_factory=ObstacleWatch)

    def __post_init__(self) -> None:
        require_positive(self, "time_step")


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
    controller: TimedController
    diagram: Diagram
    recorder: Recorder  # every step of the plant
    slow_recorder: Recorder  # every control period


class TimeSignal(LeafSystem):
    """An abstract value that is a function of time alone.

    .. pydrake_system::

        name: TimeSignal
        output_ports:
        - value

    Ports
    -----
    value : abstract, ``function(t)``.
    """

    def __init__(self, function: Callable[[float], object]) -> None:
        super().__init__()
        model = function(0.0)
        self.DeclareAbstractOutputPort(
            "value",
            alloc=lambda: AbstractValue.Make(model),
            calc=lambda context, output: output.set_value(function(_time(context))),
            prerequisites_of_calc={self.time_ticket()},
        )


def _time(context: Context) -> float:
    return context.get_time()


def add_robot(
    builder: DiagramBuilder, job: NmpcJob, time_step: float, geometry: bool = True
) -> tuple[MultibodyPlant, SceneGraph]:
    """Add the robot as a plant at the job's start, on a floor, with nothing that it touches, itself neither."""
    if geometry:
        plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step)
    else:
        plant, scene_graph = builder.AddSystem(MultibodyPlant(time_step)), builder.AddSystem(SceneGraph())
    plant.set_name("plant")
    instance = job.robot.add_to(plant)
    if geometry:
        add_floor(plant, size=FLOOR)
    plant.Finalize()
    plant.SetDefaultPositions(instance, job.start)
    if geometry:
        bodies = [plant.get_body(index) for index in plant.GetBodyIndices(instance)]
        shapes = GeometrySet([shape for body in bodies for shape in plant.GetCollisionGeometriesForBody(body)])
        scene_graph.collision_filter_manager().Apply(CollisionFilterDeclaration().ExcludeWithin(shapes))
    return plant, scene_graph


def build_nmpc(
    job: NmpcJob, params: NmpcCellParameters, meshcat: Meshcat | None = None, seen: bool = False
) -> NmpcCell:
    """Build the diagram: sensor → controller → servo → torques of the plant.

    The robot's home becomes the start, which is what the joint sensor shows before its first sample.

    Parameters
    ----------
    seen : bool
        Whether the controller gets its obstacles from a depth camera, instead of being told where they are.
    """
    robot, n, step = job.robot, job.robot.n, params.time_step
    robot.home = job.start.copy()
    builder = DiagramBuilder()
    plant, scene_graph = add_robot(builder, job, step, params.geometry)
    exact = JointSensorParameters(period=step, position_resolution=0.0, differentiate=False)
    sensor = builder.AddNamedSystem("joint_sensor", JointSensor(robot, exact))
    dynamics = builder.AddNamedSystem("dynamics", RobotDynamics(robot))
    controller = builder.AddNamedSystem(
        "controller", TimedController(robot, job.end_effector, job.points, params.controller)
    )
    servo = builder.AddNamedSystem("joint_servo", JointVelocityServo(robot, params.servo))
    order = builder.AddNamedSystem("actuator_order", MatrixGain(np.eye(n)[robot.actuator_order]))
    period, horizon = params.controller.period, params.controller.horizon
    reference = builder.AddNamedSystem(
        "reference", TimeSignal(lambda time: job.horizon_reference(time, period, horizon))
    )
    surroundings = builder.AddNamedSystem("surroundings", TimeSignal(job.obstacles))
    builder.Connect(plant.get_state_output_port(), sensor.GetInputPort("state"))
    position = sensor.GetOutputPort("position_measured")
    builder.Connect(position, dynamics.GetInputPort("position_measured"))
    builder.Connect(sensor.GetOutputPort("velocity_measured"), dynamics.GetInputPort("velocity_measured"))
    builder.Connect(position, controller.GetInputPort("position_measured"))
    builder.Connect(reference.get_output_port(), controller.GetInputPort("reference"))
    known = surroundings.get_output_port()
    if len(job.obstacles(0.0).p_WO) > 0 and np.all(job.obstacles(0.0).radius > 0.0):
        body = add_person_body(builder, scene_graph, job.obstacles(0.0))
        builder.Connect(known, body.GetInputPort("obstacles"))
    if not (params.controller.obstacle_cost or params.controller.obstacle_constraints):
        nothing = builder.AddNamedSystem("no_obstacles", TimeSignal(lambda time: ObstaclePoints(stamp=time)))
        known = nothing.get_output_port()
    elif seen:
        known = add_obstacle_watch(builder, scene_graph, job, params.watch, position)
    builder.Connect(known, controller.GetInputPort("obstacles"))
    command = controller.GetOutputPort("velocity_commanded")
    torque = servo.GetOutputPort("torque_commanded")
    if params.controller.nonholonomic:
        _add_wheels(builder, params, plant, job, torque)
    builder.Connect(command, servo.GetInputPort("velocity_commanded"))
    builder.Connect(dynamics.GetOutputPort("dynamics"), servo.GetInputPort("dynamics"))
    builder.Connect(torque, order.get_input_port())
    builder.Connect(order.get_output_port(), plant.get_actuation_input_port())
    fast, slow = Recorder(builder, step), Recorder(builder, period)
    state = plant.get_state_output_port()
    fast.add("position", state, "rad, m", lambda x: x[:n])
    fast.add("velocity", state, "rad/s, m/s", lambda x: x[n:])
    fast.add("velocity_commanded", command, "rad/s, m/s")
    fast.add("torque_excess", servo.GetOutputPort("torque_excess"), "Nm, N")
    for name, unit in (("status", "1"), ("slack", "m"), ("min_clearance", "m")):
        slow.add(name, controller.GetOutputPort(name), unit)
    slow.add("predicted_motion", controller.GetOutputPort("predicted_motion"), "rad, m")
    slow.add("obstacle_status", known, "1", lambda obstacles: [float(obstacles.status)])
    slow.add("obstacles_known", known, "m", _padded, size=4 * KNOWN)
    if meshcat is not None:
        MeshcatVisualizer.AddToBuilder(builder, scene_graph, meshcat)
    return NmpcCell(job, params, controller, builder.Build(), fast, slow)


KNOWN = 48  # obstacle points that are logged, at most


def _padded(obstacles: ObstaclePoints) -> Array:
    """Obstacle points and radii (m) as one vector of fixed size, NaN where there are none."""
    rows = np.full((KNOWN, 4), np.nan)
    count = min(len(obstacles.p_WO), KNOWN)
    rows[:count, :3], rows[:count, 3] = obstacles.p_WO[:count], obstacles.radius[:count]
    return rows.ravel()


def _add_wheels(
    builder: DiagramBuilder, params: NmpcCellParameters, plant: MultibodyPlant, job: NmpcJob, torque: OutputPort
) -> None:
    """Give the plant wheels that cannot slip sideways."""
    wheels = builder.AddNamedSystem("wheels", Wheels(job.robot, params.controller.nonholonomic, params.time_step))
    builder.Connect(plant.get_state_output_port(), wheels.GetInputPort("state"))
    builder.Connect(torque, wheels.GetInputPort("torque"))
    builder.Connect(wheels.get_output_port(), plant.get_applied_generalized_force_input_port())
