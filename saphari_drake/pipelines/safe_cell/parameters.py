"""What the safe cell is told: numbers, measured ports, robot, job and cameras."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import OutputPort

from saphari_drake.control.contact.parameters import ContactImpedanceParameters
from saphari_drake.control.hand_guiding.parameters import HandGuidingParameters
from saphari_drake.control.joint_servo import JointServoParameters
from saphari_drake.control.nmpc.parameters import NmpcParameters, TestPoint
from saphari_drake.estimation.contact_force import ContactForceParameters
from saphari_drake.estimation.model_error import ModelErrorParameters
from saphari_drake.estimation.momentum_observer import MomentumObserverParameters
from saphari_drake.parameters import require_positive, share_period
from saphari_drake.perception.camera.model import CameraParameters
from saphari_drake.perception.contact.parameters import LocalizerParameters
from saphari_drake.perception.obstacles.tracks import ObstacleTrackerParameters
from saphari_drake.perception.skin.calibration import SkinCalibration
from saphari_drake.perception.skin.estimator import SkinEstimatorParameters
from saphari_drake.perception.skin.layout import SkinLayout
from saphari_drake.perception.wrench.estimator import WristWrenchParameters
from saphari_drake.pipelines.envelope import JointState, JointWitness
from saphari_drake.pipelines.safe_cell.job_path import Job
from saphari_drake.pipelines.safe_cell.signals import (
    CellSignalParameters,
)
from saphari_drake.robots.model import RobotModel
from saphari_drake.safety.command_switch import CommandSwitchParameters
from saphari_drake.safety.contact_detector import ContactDetectorParameters
from saphari_drake.safety.contact_monitor import ContactMonitorParameters
from saphari_drake.safety.joint_check.parameters import JointCheckParameters
from saphari_drake.safety.joint_envelope.parameters import JointEnvelopeParameters
from saphari_drake.safety.power_force.parameters import PowerForceParameters
from saphari_drake.safety.speed_separation.parameters import SpeedSeparationParameters
from saphari_drake.safety.supervisor.parameters import SupervisorParameters
from saphari_drake.safety.velocity_envelope.parameters import VelocityEnvelopeParameters
from saphari_drake.safety.verified_stop.parameters import VerifiedStopParameters

Image = NDArray[np.float32]


@dataclass
class SafeCellParameters:
    """Parameters of all systems between sensors and torque; those with a period take it from here."""

    # s; the control cycle of estimation, contact, guiding and supervisor.
    period: float = 0.005
    job: NmpcParameters = field(
        default_factory=lambda: NmpcParameters(
            Q_v=[0.05], Q_q=[1e-3], R_q=[1e-3], velocity_scale=[0.6], ramp=1.0, obstacle_constraints=False, retreat=True
        )
    )
    # Of the joints, at the period and at the robot's own rate.
    check: JointCheckParameters = field(default_factory=JointCheckParameters)
    tracker: ObstacleTrackerParameters = field(default_factory=ObstacleTrackerParameters)
    separation: SpeedSeparationParameters = field(default_factory=SpeedSeparationParameters)
    force_limit: PowerForceParameters = field(default_factory=PowerForceParameters)
    supervisor: SupervisorParameters = field(default_factory=SupervisorParameters)
    signals: CellSignalParameters = field(default_factory=CellSignalParameters)
    observer: MomentumObserverParameters = field(default_factory=MomentumObserverParameters)
    model_error: ModelErrorParameters = field(default_factory=ModelErrorParameters)
    # Above what the arm's own motion and its rounded model leave. Assumed.
    detector: ContactDetectorParameters = field(default_factory=lambda: ContactDetectorParameters(threshold=1.5))
    localizer: LocalizerParameters = field(default_factory=LocalizerParameters)
    force: ContactForceParameters = field(default_factory=ContactForceParameters)
    monitor: ContactMonitorParameters = field(default_factory=ContactMonitorParameters)
    contact: ContactImpedanceParameters = field(default_factory=ContactImpedanceParameters)
    skin: SkinEstimatorParameters = field(default_factory=SkinEstimatorParameters)
    wrist: WristWrenchParameters = field(default_factory=WristWrenchParameters)
    guiding: HandGuidingParameters = field(default_factory=HandGuidingParameters)
    switch: CommandSwitchParameters = field(default_factory=CommandSwitchParameters)
    # Its torque rate is that of drives with a servo of their own: with 1000 Nm/s, that of a torque interface, a stop at
    # full braking swings about rest. Its speed margin is for people who push harder within the lag of the observer: 500
    # Nm/s over 20 ms are some rad/s² for some ms. Assumed.
    envelope: JointEnvelopeParameters = field(
        default_factory=lambda: JointEnvelopeParameters(torque_rate=3.0e4, speed_margin=0.03)
    )
    # Of the job's velocity, at the robot's own rate; the rate of the torque is that of `envelope`.
    velocity_envelope: VelocityEnvelopeParameters = field(default_factory=VelocityEnvelopeParameters)
    # Behind what the supervisor lets pass; its motion is that of the velocity envelope, its people are those of the
    # monitors.
    verified_stop: VerifiedStopParameters = field(
        default_factory=lambda: VerifiedStopParameters(envelope_behind=True, touch=True, people_timeout=0.2)
    )
    servo: JointServoParameters = field(default_factory=lambda: JointServoParameters(gain=100.0, integral_gain=2500.0))

    def __post_init__(self) -> None:
        require_positive(self, "period")
        self.velocity_envelope.torque_rate = self.envelope.torque_rate
        self.verified_stop.motion = replace(self.velocity_envelope, period=self.period)
        self.verified_stop.contact = self.force_limit
        self.verified_stop.person_speed = self.separation.person_speed
        for part in (self.signals, self.supervisor, self.skin, self.wrist, self.guiding, self.switch, self.tracker):
            part.period = self.period
        share_period(self, "observer", "model_error", "detector", "monitor", "contact")
        self.guiding.tip_frame, self.guiding.tip_point = self.wrist.tip_frame, list(self.wrist.tip_point)


class CellMeasurements(NamedTuple):
    """Ports that the pipeline is fed from: of simulated sensors, or of a real arm."""

    position: OutputPort  # n (rad or m), held over each period
    velocity: OutputPort  # n (rad/s or m/s), the same
    joint_state: JointState  # at the robot's own rate, the period of the envelope
    images: Sequence[tuple[OutputPort, OutputPort]]  # of each camera: depth image (m) and when it was taken (s)
    wrench: OutputPort  # 6 (Nm, N), reading of the wrist sensor
    voltages: OutputPort  # of the skin (V)
    sample_time: OutputPort  # when they were read (s)
    witness: JointWitness | None = None  # of the joints, at the robot's own rate


class CellSetup(NamedTuple):
    """What the pipeline is told of robot and cell."""

    robot: RobotModel
    job: Job
    points: Sequence[TestPoint]  # of the predictive controller
    cameras: Sequence[CameraParameters]
    backgrounds: Sequence[Image | None]  # depth of the scene without robot and people (m)
    layout: SkinLayout
    calibration: SkinCalibration
