"""The safe cell as one diagram: plant, people, sensors and the pipeline, which knows nothing but the sensors."""

from copy import deepcopy
from dataclasses import dataclass, replace

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.geometry import Meshcat
from pydrake.multibody.plant import ExternallyAppliedSpatialForce
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, LeafSystem

from experiments.cell.scenario import CellScenario, at_start, for_way, job_of, person_of, robot_of, seeded
from experiments.joint_state import feel_torque, joint_witness, own_joint_state
from experiments.nmpc.manipulator import points_along
from saphari_drake.perception.segmentation.background import background_depth
from saphari_drake.perception.skin.calibration import calibrate
from saphari_drake.perception.skin.layout import SkinLayout
from saphari_drake.pipelines.safe_cell.cell import SafeCell, add_safe_cell
from saphari_drake.pipelines.safe_cell.job_path import Job
from saphari_drake.pipelines.safe_cell.parameters import CellMeasurements, CellSetup, SafeCellParameters
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.faults.cameras import inject_into_camera
from saphari_drake.simulation.faults.injection import inject_into
from saphari_drake.simulation.people.compliant_people import CompliantPeople
from saphari_drake.simulation.people.guiding_hands import Grip, GuidingHands
from saphari_drake.simulation.people.performance import performance
from saphari_drake.simulation.people.shown_people import show_people
from saphari_drake.simulation.record.recorder import Recorder
from saphari_drake.simulation.record.robot import record_robot
from saphari_drake.simulation.sensors.background_scan import scan_background
from saphari_drake.simulation.sensors.depth_noise import DepthCameraSampler
from saphari_drake.simulation.sensors.force_torque_sensor import ForceTorqueSensor
from saphari_drake.simulation.sensors.joint_sensor import JointSensor
from saphari_drake.simulation.sensors.rgbd_camera import add_depth_camera
from saphari_drake.simulation.sensors.skin_indenter import indent
from saphari_drake.simulation.sensors.skin_modules import SkinModules
from saphari_drake.simulation.sensors.skin_sensor import SkinSensor
from saphari_drake.simulation.view.replay import show
from saphari_drake.simulation.world.cell import Cell, add_cell
from saphari_drake.simulation.world.floor import Floor
from saphari_drake.simulation.world.profile import Truth

FLOOR = 8.0  # m; edge of the floor
FRAME = 1.0 / 30.0  # s, of what is recorded for the eye
COARSENESS = (
    0.005  # share of a drive's torque by which its measured one may be off: platforms tell it by their currents
)


class JoinedForces(LeafSystem):
    """Joins the forces of several sources on one plant.

    .. pydrake_system::

        name: JoinedForces
        input_ports:
        - (each source)
        output_ports:
        - applied_forces

    Ports
    -----
    (each source), applied_forces : abstract lists of `ExternallyAppliedSpatialForce`.
    """

    def __init__(self, count: int) -> None:
        super().__init__()
        empty = Value[list[ExternallyAppliedSpatialForce]]()
        self._ports = [self.DeclareAbstractInputPort(f"forces_{k}", empty) for k in range(count)]
        self.DeclareAbstractOutputPort(
            "applied_forces",
            alloc=lambda: Value[list[ExternallyAppliedSpatialForce]](),
            calc=self._calc,
            prerequisites_of_calc={self.all_input_ports_ticket()},
        )

    def _calc(self, context: Context, output: AbstractValue) -> None:
        output.set_value([force for port in self._ports for force in port.Eval(context)])


@dataclass
class SafeCellRig:
    """A diagram and what is needed to run and judge it."""

    scenario: CellScenario
    robot: RobotModel
    cell: Cell
    people: CompliantPeople
    pipeline: SafeCell
    diagram: Diagram
    fast: Recorder  # every step of the plant
    slow: Recorder  # every frame


def build_cell(
    scenario: CellScenario, trial: int = 0, way: str = "supervised", meshcat: Meshcat | None = None
) -> SafeCellRig:
    """Build the diagram of one trial."""
    scenario = seeded(scenario, trial)
    builder, params = DiagramBuilder(), for_way(scenario, way)
    robot = robot_of(scenario)
    job, robot = job_of(robot, scenario), at_start(robot, scenario)
    truth, step = scenario.truth(params.period), scenario.plant_parameters.time_step
    cell = add_cell(builder, robot, [Floor(FLOOR)], scenario.plant_parameters, truth)
    person = performance(person_of(scenario, trial), scenario.people.sizes)
    people = CompliantPeople(robot, cell.plant, cell.instance, [person], scenario.people, step)
    builder.AddNamedSystem("people_in_the_cell", people)
    show_people(builder, cell.scene_graph, people)
    builder.Connect(cell.robot_state, people.GetInputPort("state"))
    measured, setup = _sensors(builder, scenario, job, cell, people, params, truth)
    pipeline = add_safe_cell(builder, setup, measured, params)
    builder.Connect(pipeline.torque_output, cell.torque_input)
    feel_torque(builder, cell, pipeline.torque_output)
    # It is the first camera that fails.
    sampler = builder.GetSubsystemByName("camera_sampler_0")
    inject_into_camera(builder, cell.scene_graph, scenario.cameras[0], sampler, scenario.sampler, truth)
    fast = record_robot(builder, cell, step)
    fast.add("torque", pipeline.torque_output, "Nm")
    fast.add("touch", people.GetOutputPort("touch"), "N, m")
    fast.add("gap", people.GetOutputPort("gap"), "m")
    for name in ("state", "reason", "fault"):
        fast.add(name, pipeline.supervisor.GetOutputPort(name), "1")
    slow = record_robot(builder, cell, FRAME)
    slow.add("ends", people.GetOutputPort("ends"), "m")
    slow.add("progress", pipeline.job.GetOutputPort("progress"), "s")
    slow.add("speed_limit", pipeline.supervisor.GetOutputPort("speed_limit"), "1")
    slow.add("separation", pipeline.separation.GetOutputPort("separation"), "m")
    slow.add("protective_distance", pipeline.separation.GetOutputPort("protective_distance"), "m")
    slow.add("scale_separation", pipeline.separation.GetOutputPort("speed_scale"), "1")
    slow.add("scale_force", pipeline.force_limit.GetOutputPort("speed_scale"), "1")
    for name in ("energy", "energy_limit"):
        slow.add(name, pipeline.force_limit.GetOutputPort(name), "J")
    slow.add("people_seen", pipeline.people.GetOutputPort("obstacles"), "1", lambda p: [float(len(p.p_WO))], 1)
    slow.add("nmpc_status", pipeline.nmpc.GetOutputPort("status"), "1")
    slow.add("stop_status", builder.GetSubsystemByName("verified_stop").GetOutputPort("status"), "1")
    inject_into(builder, cell, truth)
    show(builder, cell.scene_graph, meshcat)
    return SafeCellRig(scenario, robot, cell, people, pipeline, builder.Build(), fast, slow)


def _sensors(
    builder: DiagramBuilder,
    scenario: CellScenario,
    job: Job,
    cell: Cell,
    people: CompliantPeople,
    params: SafeCellParameters,
    truth: Truth,
) -> tuple[CellMeasurements, CellSetup]:
    """Add all sensors, and return what they measure and what the pipeline is told."""
    robot = cell.robot
    add, layout = builder.AddNamedSystem, SkinLayout(robot, scenario.skin_layout)
    joints = add("joint_sensor", JointSensor(robot, truth.joint_sensor(scenario.joint_sensor)))
    skin = add("skin_sensor", SkinSensor(layout, robot, cell.plant, cell.instance, scenario.skin_sensor))
    wrist = add("force_sensor", ForceTorqueSensor(cell.plant, cell.instance, scenario.force_sensor))
    tip = Grip(robot.n - 1, np.array([0.0, 0.0, 0.05]), scenario.hand)
    hands = add("hands", GuidingHands(robot, cell.plant, cell.instance, [tip], scenario.plant_parameters.time_step))
    forces = add("forces", JoinedForces(2))
    for k, source in enumerate((people, hands)):
        builder.Connect(source.GetOutputPort("applied_forces"), forces.GetInputPort(f"forces_{k}"))
    builder.Connect(forces.get_output_port(), cell.plant.get_applied_spatial_force_input_port())
    builder.Connect(forces.get_output_port(), skin.GetInputPort("applied_forces"))
    builder.Connect(cell.plant.get_reaction_forces_output_port(), wrist.GetInputPort("reaction_forces"))
    for system in (joints, skin, hands):
        builder.Connect(cell.robot_state, system.GetInputPort("state"))
    images, backgrounds = [], []
    for k, params_k in enumerate(scenario.cameras):
        view = add_depth_camera(builder, cell.scene_graph, params_k, f"camera_{k}")
        own = deepcopy(scenario.sampler)
        own.noise.seed += k
        sampler = DepthCameraSampler(params_k, truth.sampler(own))
        add(f"camera_sampler_{k}", sampler)
        builder.Connect(view.GetOutputPort("depth_image_32f"), sampler.GetInputPort("depth_image"))
        images.append(sampler)
        empty = scan_background(robot, Floor(FLOOR), params_k, own.noise, 4)
        backgrounds.append(background_depth(empty, params.localizer))
    params.localizer.frozen_frames = 2 if scenario.sampler.noise.enabled else 0
    measured = CellMeasurements(
        joints.GetOutputPort("position_measured"),
        joints.GetOutputPort("velocity_measured"),
        own_joint_state(builder, robot, cell, scenario.joint_sensor, params.envelope, params.observer, truth),
        [(sampler.GetOutputPort("depth_image"), sampler.GetOutputPort("image_time")) for sampler in images],
        wrist.GetOutputPort("wrench_sensor"),
        skin.GetOutputPort("voltages"),
        skin.GetOutputPort("sample_time"),
        joint_witness(builder, robot, cell, replace(scenario.joint_sensor, period=params.envelope.period), truth),
    )
    params.check.torque_tolerance = np.maximum(params.check.torque_tolerance, COARSENESS * robot.tau_max).tolist()
    calibration = calibrate(layout, indent(SkinModules(layout, scenario.skin_sensor.modules)))
    points = points_along(robot, robot.link_names[-1], 0.08, 5e-6)
    return measured, CellSetup(robot, job, points, scenario.cameras, backgrounds, layout, calibration)
