"""From joint state and depth image to an answered contact: the systems of Section 7, wired."""

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import DiagramBuilder, OutputPort

from saphari_drake.control.contact.force_system import ContactForceController
from saphari_drake.control.contact.parameters import ContactForceControlParameters, ContactImpedanceParameters
from saphari_drake.control.contact.stability import check_hand
from saphari_drake.control.contact.system import ContactImpedanceController
from saphari_drake.estimation.contact_force import ContactForceEstimator, ContactForceParameters
from saphari_drake.estimation.model_error import ModelErrorEstimator, ModelErrorParameters
from saphari_drake.estimation.momentum_observer import MomentumObserver, MomentumObserverParameters
from saphari_drake.parameters import require_positive, share_period
from saphari_drake.perception.camera.check_parameters import CameraCheckParameters
from saphari_drake.perception.camera.check_system import CameraCheck, CheckScheduleParameters
from saphari_drake.perception.camera.frame_check import FrameCheckParameters
from saphari_drake.perception.camera.frame_check_system import FrameCheck
from saphari_drake.perception.camera.model import CameraParameters
from saphari_drake.perception.contact.localizer import ContactLocalizer
from saphari_drake.perception.contact.parameters import FusionParameters, LocalizerParameters
from saphari_drake.pipelines.contact_detection import add_contact_detection
from saphari_drake.pipelines.envelope import JointState, JointWitness, add_joint_check, add_joint_envelope
from saphari_drake.robots.dynamics import RobotDynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.safety.command_switch import CommandSwitch, CommandSwitchParameters
from saphari_drake.safety.contact_detector import ContactDetector, ContactDetectorParameters
from saphari_drake.safety.contact_monitor import ContactMonitor, ContactMonitorParameters
from saphari_drake.safety.joint_check.parameters import JointCheckParameters
from saphari_drake.safety.joint_envelope.parameters import JointEnvelopeParameters
from saphari_drake.safety.joint_envelope.system import JointEnvelope
from saphari_drake.systems import connect


@dataclass
class ContactPipelineParameters:
    """Parameters of all systems between sensors and torque."""

    # s; the control cycle of all parts, which take it from here. That of the deliverable.
    period: float = 0.005
    check: JointCheckParameters = field(default_factory=JointCheckParameters)
    # Its velocity is expected to be a difference of positions, as encoders give it.
    observer: MomentumObserverParameters = field(default_factory=lambda: MomentumObserverParameters(velocity_delay=0.5))
    # What the robot's model may lack; learned while nobody touches.
    model_error: ModelErrorParameters = field(default_factory=ModelErrorParameters)
    detector: ContactDetectorParameters = field(
        default_factory=lambda: ContactDetectorParameters(smoothed_threshold=0.5)
    )
    localizer: LocalizerParameters = field(default_factory=LocalizerParameters)
    # What finds hidden contacts. The residual's noise is measured; the cone is wide, as fingers hook at edges and the
    # cover's normals are not those of the model.
    fusion: FusionParameters = field(default_factory=lambda: FusionParameters(torque_sigma=0.05, friction=1.5, modes=6))
    # Of the camera's pose, which is corrected while nobody is in view; and of its frames.
    camera_check: CameraCheckParameters = field(default_factory=CameraCheckParameters)
    camera_schedule: CheckScheduleParameters = field(default_factory=CheckScheduleParameters)
    frames: FrameCheckParameters = field(default_factory=FrameCheckParameters)
    force: ContactForceParameters = field(default_factory=ContactForceParameters)
    monitor: ContactMonitorParameters = field(default_factory=ContactMonitorParameters)
    # The answer to a contact: an impedance, or a force.
    controller: ContactImpedanceParameters | ContactForceControlParameters = field(
        default_factory=ContactImpedanceParameters
    )
    switch: CommandSwitchParameters = field(default_factory=CommandSwitchParameters)
    envelope: JointEnvelopeParameters = field(default_factory=JointEnvelopeParameters)

    def __post_init__(self) -> None:
        require_positive(self, "period")
        share_period(self, "check", "observer", "model_error", "detector", "monitor", "controller", "switch")
        if isinstance(self.controller, ContactForceControlParameters):
            check_hand(self.controller, float(np.min(self.observer.bandwidth)))


class ContactMeasurements(NamedTuple):
    """Ports that the pipeline is fed from: of simulated sensors, or of a real arm."""

    position: OutputPort  # n (rad or m), held over each period
    velocity: OutputPort  # n (rad/s or m/s), the same
    depth_image: OutputPort  # of the camera (m)
    image_time: OutputPort  # when it was taken (s)
    joint_state: JointState | None = None  # at the robot's own rate, the period of the envelope
    witness: JointWitness | None = None


class ContactPipeline(NamedTuple):
    """The systems that others look at."""

    dynamics: RobotDynamics
    observer: MomentumObserver
    model_error: ModelErrorEstimator
    detector: ContactDetector
    localizer: ContactLocalizer
    camera_check: CameraCheck
    frames: FrameCheck
    monitor: ContactMonitor
    force: ContactForceEstimator
    controller: ContactImpedanceController | ContactForceController
    switch: CommandSwitch
    envelope: JointEnvelope

    @property
    def torque_output(self) -> OutputPort:
        """Joint torque, n (Nm)."""
        return self.envelope.GetOutputPort("torque_applied")


def add_contact_pipeline(
    builder: DiagramBuilder,
    robot: RobotModel,
    measured: ContactMeasurements,
    camera: CameraParameters,
    params: ContactPipelineParameters | None = None,
    background: NDArray[np.float32] | None = None,
) -> ContactPipeline:
    """Add all systems from the observer to the joint envelope, and connect them.

    Parameters
    ----------
    builder :
        The diagram to add to.
    robot :
        The robot that is controlled.
    measured :
        What it measures.
    camera :
        Pose and optics of the depth camera.
    background : (height, width) float32 array, optional
        Depth of the scene without robot and person (m), from `background_depth`.
    """
    params = params or ContactPipelineParameters()
    params.__post_init__()  # its parts take the period
    add = builder.AddNamedSystem
    switch = add("command_switch", CommandSwitch(robot, params.switch))
    observer = add("momentum_observer", MomentumObserver(robot, params.observer))
    joints = JointState(measured.position, measured.velocity)
    checked = add_joint_check(builder, robot, joints, params.check, measured.witness)
    torque_external, held = observer.GetOutputPort("torque_external"), checked.state
    model_error, detector = add_contact_detection(
        builder, robot, observer, params.observer, params.model_error, params.detector
    )
    p = ContactPipeline(
        dynamics=add("dynamics", RobotDynamics(robot)),
        observer=observer,
        model_error=model_error,
        detector=detector,
        localizer=add(
            "contact_localizer",
            ContactLocalizer(
                robot, [camera], params.localizer, [background], fusion=params.fusion, period=params.period
            ),
        ),
        camera_check=add(
            "camera_check",
            CameraCheck(robot, camera, params.camera_check, params.camera_schedule, period=params.period),
        ),
        frames=add("frame_check", FrameCheck(robot, camera, params.frames, background, params.period)),
        monitor=add("contact_monitor", ContactMonitor(robot, params.monitor)),
        force=add("contact_force", ContactForceEstimator(robot, params.force)),
        controller=add("controller", _controller(robot, params)),
        switch=switch,
        envelope=add_joint_envelope(
            builder, robot, switch, torque_external, held, measured.joint_state, params.envelope, params.period
        ),
    )
    for source, target, name in (
        (held.position, p.dynamics, "position_measured"),
        (held.velocity, p.dynamics, "velocity_measured"),
        (held.position, p.localizer, "position_measured"),
        (measured.depth_image, p.localizer, "depth_image"),
        (measured.image_time, p.localizer, "image_time"),
        (held.position, p.camera_check, "position_measured"),
        (measured.depth_image, p.camera_check, "depth_image"),
        (measured.image_time, p.camera_check, "image_time"),
        (held.position, p.frames, "position_measured"),
        (measured.depth_image, p.frames, "depth_image"),
        (measured.image_time, p.frames, "image_time"),
        (p.monitor.GetOutputPort("active_contact"), p.force, "contact_point"),
        (p.envelope.GetOutputPort("torque_mean"), p.observer, "torque_applied"),
    ):
        builder.Connect(source, target.GetInputPort(name))
    checked.close(builder, p.envelope.GetOutputPort("torque_acting"), measured.witness)
    connect(
        builder,
        (p.dynamics, "dynamics", p.observer, p.model_error),
        (p.observer, "friction_uncertainty", p.force),
        (p.observer, "friction_torque", p.controller),
        # The model corrected by what was learned, from here on.
        (p.model_error, "dynamics", p.monitor, p.force, p.controller, p.switch),
        (p.model_error, "torque_external", p.force, p.localizer),
        (p.model_error, "torque_noise", p.localizer),
        (p.detector, "contact", p.monitor, p.localizer),
        (p.localizer, "contact_point", p.monitor, p.detector),
        (p.localizer, "camera_status", p.frames),
        (p.localizer, "human_points", p.camera_check),
        (p.camera_check, "correction", p.localizer),
        (p.frames, "camera_status", p.monitor),
        (p.monitor, "interaction", p.controller),
        (p.force, "contact_force", p.controller),
        (p.force, "misfit", p.controller),
        (p.controller, "selection", p.switch),
        (p.controller, "torque_commanded", p.switch),
    )
    if isinstance(p.controller, ContactForceController):
        connect(
            builder, (p.force, "unobservable_directions", p.controller), (p.switch, "transition_left", p.controller)
        )
    return p


def _controller(
    robot: RobotModel, params: ContactPipelineParameters
) -> ContactImpedanceController | ContactForceController:
    given = params.controller
    if isinstance(given, ContactForceControlParameters):
        return ContactForceController(robot, replace(given, torque_delay=params.envelope.torque_delay))
    return ContactImpedanceController(robot, given)
