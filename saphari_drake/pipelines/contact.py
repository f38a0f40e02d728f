"""From joint state and depth image to an answered contact: the systems of Section 7, wired."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import DiagramBuilder, InputPort, LeafSystem

from saphari_drake.control.contact.force import ContactForceController
from saphari_drake.control.contact.force_parameters import ContactForceControlParameters
from saphari_drake.control.contact.impedance import ContactImpedanceController, ContactImpedanceParameters
from saphari_drake.control.contact.stability import check_hand
from saphari_drake.errors import ParameterError
from saphari_drake.estimation.contact_force import ContactForceEstimator, ContactForceParameters
from saphari_drake.estimation.momentum_observer import MomentumObserver, MomentumObserverParameters
from saphari_drake.perception.camera.model import CameraParameters
from saphari_drake.perception.contact.localizer import ContactLocalizer
from saphari_drake.perception.contact.parameters import LocalizerParameters
from saphari_drake.robots.dynamics import RobotDynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.safety.contact_detector import ContactDetector, ContactDetectorParameters
from saphari_drake.safety.contact_monitor import ContactMonitor, ContactMonitorParameters
from saphari_drake.simulation.sensors.joint_sensor import JointSensor, JointSensorParameters


@dataclass
class ContactPipelineParameters:
    """Parameters of all systems between sensors and torque; their cycles must be equal."""

    joint_sensor: JointSensorParameters = field(default_factory=JointSensorParameters)
    observer: MomentumObserverParameters = field(default_factory=MomentumObserverParameters)
    detector: ContactDetectorParameters = field(default_factory=ContactDetectorParameters)
    localizer: LocalizerParameters = field(default_factory=LocalizerParameters)
    force: ContactForceParameters = field(default_factory=ContactForceParameters)
    monitor: ContactMonitorParameters = field(default_factory=ContactMonitorParameters)
    # The answer to a contact: an impedance, or a force.
    controller: ContactImpedanceParameters | ContactForceControlParameters = field(
        default_factory=ContactImpedanceParameters
    )

    def __post_init__(self) -> None:
        for name in ("observer", "detector", "monitor", "controller"):
            if getattr(self, name).period != self.joint_sensor.period:
                raise ParameterError(f"{name}.period", f"must equal joint_sensor.period, {self.joint_sensor.period} s")
        if isinstance(self.controller, ContactForceControlParameters):
            check_hand(self.controller, float(np.min(self.observer.gain)))


@dataclass
class ContactPipeline:
    """The systems, and the inputs that are left to connect."""

    joint_sensor: JointSensor
    dynamics: RobotDynamics
    observer: MomentumObserver
    detector: ContactDetector
    localizer: ContactLocalizer
    monitor: ContactMonitor
    force: ContactForceEstimator
    controller: ContactImpedanceController | ContactForceController

    @property
    def state_input(self) -> InputPort:
        """Joint state of the robot, 2n."""
        return self.joint_sensor.GetInputPort("state")

    @property
    def depth_input(self) -> InputPort:
        """Depth image of the camera."""
        return self.localizer.GetInputPort("depth_image")

    @property
    def image_time_input(self) -> InputPort:
        """Time at which it was taken (s)."""
        return self.localizer.GetInputPort("image_time")

    @property
    def torque_output(self):
        """Joint torque, n (Nm)."""
        return self.controller.GetOutputPort("torque_commanded")


def add_contact_pipeline(
    builder: DiagramBuilder,
    robot: RobotModel,
    camera: CameraParameters,
    params: ContactPipelineParameters | None = None,
    background: NDArray[np.float32] | None = None,
) -> ContactPipeline:
    """Add sensor, observer, detector, localizer, monitor, force estimator and controller, and connect them.

    Parameters
    ----------
    builder :
        The diagram to add to.
    robot :
        The robot that is controlled.
    camera :
        Pose and optics of the depth camera.
    background : (height, width) float32 array, optional
        Depth of the scene without robot and person (m), from `background_depth`.
    """
    params = params or ContactPipelineParameters()

    def add(name: str, system: LeafSystem):
        return builder.AddNamedSystem(name, system)

    p = ContactPipeline(
        joint_sensor=add("joint_sensor", JointSensor(robot, params.joint_sensor)),
        dynamics=add("dynamics", RobotDynamics(robot)),
        observer=add("momentum_observer", MomentumObserver(robot, params.observer)),
        detector=add("contact_detector", ContactDetector(robot.n, params.detector)),
        localizer=add(
            "contact_localizer",
            ContactLocalizer(robot, [camera], params.localizer, [background], period=params.joint_sensor.period),
        ),
        monitor=add("contact_monitor", ContactMonitor(robot, params.monitor)),
        force=add("contact_force", ContactForceEstimator(robot, params.force)),
        controller=add("controller", _controller(robot, params.controller)),
    )
    wires = (
        (p.joint_sensor, "position_measured", p.dynamics, "position_measured"),
        (p.joint_sensor, "velocity_measured", p.dynamics, "velocity_measured"),
        (p.joint_sensor, "position_measured", p.localizer, "position_measured"),
        (p.dynamics, "dynamics", p.observer, "dynamics"),
        (p.dynamics, "dynamics", p.monitor, "dynamics"),
        (p.dynamics, "dynamics", p.force, "dynamics"),
        (p.dynamics, "dynamics", p.controller, "dynamics"),
        (p.observer, "residual", p.detector, "residual"),
        (p.observer, "residual", p.force, "residual"),
        (p.observer, "residual", p.localizer, "residual"),
        (p.force, "misfit", p.controller, "misfit"),
        (p.detector, "contact", p.monitor, "contact"),
        (p.localizer, "contact_point", p.monitor, "contact_point"),
        (p.localizer, "camera_status", p.monitor, "camera_status"),
        (p.monitor, "active_contact", p.force, "contact_point"),
        (p.monitor, "interaction", p.controller, "interaction"),
        (p.force, "contact_force", p.controller, "contact_force"),
        (p.controller, "torque_commanded", p.observer, "torque_commanded"),
    )
    for source, output, target, target_port in wires:
        builder.Connect(source.GetOutputPort(output), target.GetInputPort(target_port))
    if isinstance(p.controller, ContactForceController):
        hidden = "unobservable_directions"
        builder.Connect(p.force.GetOutputPort(hidden), p.controller.GetInputPort(hidden))
    return p


def _controller(
    robot: RobotModel, params: ContactImpedanceParameters | ContactForceControlParameters
) -> ContactImpedanceController | ContactForceController:
    if isinstance(params, ContactForceControlParameters):
        return ContactForceController(robot, params)
    return ContactImpedanceController(robot, params)
