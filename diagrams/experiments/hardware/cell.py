"""A diagram for one robot: its station, simulated or real, and one way of control."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike
from pydrake.geometry import Meshcat
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from experiments.contact.known import adapt_to_encoders, adapt_to_friction
from experiments.hardware.pipelines import (
    Driven,
    TouchParameters,
    add_contact_impedance,
    add_hand_guiding,
    add_null_space,
)
from experiments.hardware.rod import Rod, rail
from experiments.hardware.rod_law import RodParameters
from experiments.joint_state import COARSE
from saphari_drake.pipelines.null_space import NullSpacePipelineParameters
from saphari_drake.robots import catalog
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.record.recorder import Recorder
from saphari_drake.simulation.runner.plant_scenario import PlantScenario
from saphari_drake.simulation.sensors.joint_sensor import JointSensor, JointSensorParameters
from saphari_drake.simulation.view.replay import show
from saphari_drake.simulation.world.cell import Cell, add_cell, contact_truth
from saphari_drake.simulation.world.floor import Floor
from saphari_drake.simulation.world.plant import PlantParameters
from saphari_drake.simulation.world.profile import Truth
from saphari_drake.stations.parameters import StationParameters
from saphari_drake.stations.ports import StationPorts
from saphari_drake.stations.shared import Link, StationStatus
from saphari_drake.stations.station import RobotStation

FR3_HOME = [0.0, -45.0, 0.0, -135.0, 0.0, 90.0, 45.0]  # deg; of its maker
SIM = "sim"


@dataclass
class HardwareScenario(PlantScenario):
    """Everything a run depends on."""

    case: str = "contact_impedance"
    duration: float = 6.0
    # Where the robot is: sim, fci://HOST, lcm or lcm://URL; by --robot.
    address: str = SIM
    # Catalog name, or path of a URDF or SDF; empty: the FR3 that is shipped.
    robot: str = ""
    # deg; posture at the start of a simulated robot. Empty: the model's own home. A real robot starts where it is.
    home: list[float] = field(default_factory=lambda: list(FR3_HOME))
    # What pushes a simulated robot. On a real one its link and aim are where a person is told to push.
    rod: RodParameters = field(default_factory=RodParameters)
    touch: TouchParameters = field(default_factory=TouchParameters)
    null_space: NullSpacePipelineParameters = field(default_factory=NullSpacePipelineParameters)
    station: StationParameters = field(default_factory=StationParameters)
    # s; from the sample of a real robot to the torque that the diagram makes of it. Assumed: one cycle of a loop of
    # 1 kHz to take the command, one until it acts.
    command_delay: float = 0.002

    @property
    def pipeline(self) -> TouchParameters | NullSpacePipelineParameters:
        """The parameters of the case's pipeline."""
        return self.null_space if self.case == "null_space" else self.touch

    def loaded(self, home: ArrayLike = ()) -> RobotModel:
        """Return the robot as its file and `model` have it; `home` in deg, empty: its own."""
        path = self.robot or str(catalog.models_dir() / "fr3" / "fr3.urdf")
        return catalog.load(path, home=np.deg2rad(home), options=self.model)


@dataclass
class Setup:
    """A diagram and what is needed to run and judge it."""

    scenario: HardwareScenario
    robot: RobotModel
    diagram: Diagram
    recorder: Recorder
    cell: Cell | None  # of a simulated robot


def build(
    scenario: HardwareScenario, robot: RobotModel, link: Link | None = None, meshcat: Meshcat | None = None
) -> Setup:
    """Build the diagram of a scenario, with the shared memory of a real robot's loop or with a simulated robot."""
    builder, cell = DiagramBuilder(), None
    if link is None:
        cell, station = simulated_station(builder, scenario, robot)
    else:
        scenario.station.period = scenario.pipeline.period
        _tell_delays(scenario, 0.0, scenario.command_delay)
        system = builder.AddNamedSystem("station", RobotStation(robot, link, scenario.station))
        station = system.ports
    driven = add_control(builder, scenario, robot, station)
    builder.Connect(driven.torque, station.torque_applied)
    recorder = Recorder(builder, scenario.pipeline.period)
    for name, unit in (
        ("position_measured", "rad"),
        ("velocity_measured", "rad/s"),
        ("torque_acting", "Nm"),
        ("status", "1"),
        ("missed_cycles", "1"),
    ):
        recorder.add(name, getattr(station, name), unit)
    for name, unit, port in driven.told:
        recorder.add(name, port, unit)
    if cell is not None:
        recorder.add("contact_truth", cell.contact_results, "N", lambda results: contact_truth(results, cell)[:3], 3)
        show(builder, cell.scene_graph, meshcat)
        recorder.add("plant_position", cell.plant.get_state_output_port(), "mixed", _positions(cell))
    return Setup(scenario, robot, builder.Build(), recorder, cell)


def _positions(cell: Cell):
    return lambda state: state[: cell.plant.num_positions()]


def add_control(
    builder: DiagramBuilder, scenario: HardwareScenario, robot: RobotModel, station: StationPorts
) -> Driven:
    """Add the pipeline of the case."""
    rod = scenario.rod
    if scenario.case == "contact_impedance":
        motion, index = robot.kinematics(robot.home), robot.link_index(rod.link)
        origin, direction = rail(robot, rod)
        p_W = origin + (rod.gap + rod.radius) * direction
        p_L = motion.R_WL[index].T @ (p_W - motion.p_WL[index])
        return add_contact_impedance(builder, robot, station, scenario.touch, rod.link, p_L.tolist())
    if scenario.case == "null_space":
        return add_null_space(builder, robot, station, scenario.null_space)
    return add_hand_guiding(builder, robot, station, scenario.touch)


def simulated_station(
    builder: DiagramBuilder, scenario: HardwareScenario, robot: RobotModel
) -> tuple[Cell, StationPorts]:
    """Add a simulated robot that the rod pushes, behind the ports of a station."""
    period = scenario.pipeline.period
    truth = scenario.truth(period)
    cell = add_cell(builder, robot, [Rod(scenario.rod), Floor()], PlantParameters(), truth)
    encoders = truth.joint_sensor(JointSensorParameters(period, position_resolution=0.0, differentiate=False))
    _adapt(scenario, robot, encoders, truth)
    sensor = builder.AddNamedSystem("joint_sensor", JointSensor(robot, encoders))
    builder.Connect(cell.robot_state, sensor.GetInputPort("state"))
    torque = cell.torque_driving or cell.plant.get_net_actuation_output_port(cell.instance)
    always = builder.AddNamedSystem("status", ConstantVectorSource([float(StationStatus.OK)]))
    missed = builder.AddNamedSystem("missed_cycles", ConstantVectorSource([0.0]))
    ports = StationPorts(
        cell.torque_input,
        sensor.GetOutputPort("position_measured"),
        sensor.GetOutputPort("velocity_measured"),
        torque,
        torque,
        always.get_output_port(),
        missed.get_output_port(),
    )
    return cell, ports


def _adapt(scenario: HardwareScenario, robot: RobotModel, encoders: JointSensorParameters, truth: Truth) -> None:
    """Tell the pipeline what is known of a simulated robot: its encoders and the delay of its torques."""
    pipeline, late = scenario.pipeline, encoders.differentiate
    if late and scenario.case != "contact_impedance" and encoders.position_resolution > COARSE * encoders.period:
        pipeline.velocity.resolution, late = encoders.position_resolution, False
    delay = truth.profile.torque_delay * truth.period
    _tell_delays(scenario, 0.5 if late else 0.0, 0.0)
    pipeline.envelope.torque_delay = delay
    if scenario.case == "contact_impedance":
        adapt_to_encoders(scenario.touch, robot, encoders)  # type: ignore[arg-type]
        adapt_to_friction(scenario.touch, encoders)  # type: ignore[arg-type]


def _tell_delays(scenario: HardwareScenario, velocity: float, torque: float) -> None:
    pipeline = scenario.pipeline
    observer = pipeline.observer if isinstance(pipeline, TouchParameters) else pipeline.momentum
    observer.velocity_delay, observer.torque_delay = velocity, torque
