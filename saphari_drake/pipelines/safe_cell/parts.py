"""The methods of the safe cell, each with what feeds it."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from pydrake.systems.framework import DiagramBuilder

from saphari_drake.control.contact.system import ContactImpedanceController
from saphari_drake.control.hand_guiding.system import HandGuidingController
from saphari_drake.control.joint_servo import JointVelocityServo
from saphari_drake.control.nmpc.system import NmpcController
from saphari_drake.estimation.contact_force import ContactForceEstimator
from saphari_drake.estimation.joint_acceleration import JointAcceleration
from saphari_drake.estimation.model_error import ModelErrorEstimator
from saphari_drake.estimation.momentum_observer import MomentumObserver
from saphari_drake.estimation.torque_window import TorqueWindow
from saphari_drake.perception.contact.localizer import ContactLocalizer
from saphari_drake.perception.obstacles.merge import MergedObstacles
from saphari_drake.perception.obstacles.tracker import ObstacleTracker
from saphari_drake.perception.skin.estimator import SkinEstimator
from saphari_drake.perception.wrench.estimator import WristWrenchEstimator
from saphari_drake.pipelines.contact_detection import add_contact_detection
from saphari_drake.pipelines.safe_cell.job_path import JobPath
from saphari_drake.pipelines.safe_cell.parameters import CellMeasurements, CellSetup, SafeCellParameters
from saphari_drake.pipelines.safe_cell.signals import (
    HoldDetector,
    ScaledVelocity,
    SpeedChoice,
)
from saphari_drake.robots.dynamics import RobotDynamics
from saphari_drake.safety.contact_detector import ContactDetector
from saphari_drake.safety.contact_monitor import ContactMonitor
from saphari_drake.safety.power_force.system import PowerForceLimit
from saphari_drake.safety.speed_separation.system import SpeedSeparation
from saphari_drake.safety.velocity_envelope.system import VelocityEnvelope
from saphari_drake.safety.verified_stop.system import VerifiedStop
from saphari_drake.systems import connect


def add_people(
    builder: DiagramBuilder, setup: CellSetup, measured: CellMeasurements, params: SafeCellParameters
) -> MergedObstacles:
    """Add what turns the cameras' images into people."""
    merged = builder.AddNamedSystem("people", MergedObstacles(len(setup.cameras)))
    for k, (camera, background, (image, time)) in enumerate(zip(setup.cameras, setup.backgrounds, measured.images)):
        tracker = ObstacleTracker(setup.robot, camera, params.tracker, params.localizer, background)
        builder.AddNamedSystem(f"obstacle_tracker_{k}", tracker)
        builder.Connect(measured.position, tracker.GetInputPort("position_measured"))
        builder.Connect(image, tracker.GetInputPort("depth_image"))
        builder.Connect(time, tracker.GetInputPort("image_time"))
        builder.Connect(tracker.GetOutputPort("obstacles"), merged.GetInputPort(f"obstacles_{k}"))
    return merged


class JobParts(NamedTuple):
    """The job, and what slows it down."""

    path: JobPath
    nmpc: NmpcController
    separation: SpeedSeparation
    force_limit: PowerForceLimit
    choice: SpeedChoice
    scaled: ScaledVelocity
    stop: VerifiedStop
    servo: JointVelocityServo


def add_job(
    builder: DiagramBuilder, setup: CellSetup, measured: CellMeasurements, params: SafeCellParameters
) -> JobParts:
    """Add the predictive controller, its job, monitors, verified stop and servo."""
    robot, add, own = setup.robot, builder.AddNamedSystem, params.job
    envelope = add("velocity_envelope", VelocityEnvelope(robot, params.velocity_envelope))
    fast = add("servo_dynamics", RobotDynamics(robot))
    acceleration = np.minimum(np.broadcast_to(own.acceleration_max, (robot.n,)), 0.5 * envelope.bounds.acceleration)
    own = replace(own, acceleration_max=acceleration.tolist())
    parts = JobParts(
        add("job_path", JobPath(robot, setup.job, own.period, own.horizon)),
        add("controller", NmpcController(robot, setup.job.end_effector, setup.points, own)),
        add("speed_separation", SpeedSeparation(robot, params.separation)),
        add("power_force", PowerForceLimit(robot, params.force_limit)),
        add("speed_choice", SpeedChoice(params.signals)),
        add("scaled_velocity", ScaledVelocity(robot.n)),
        add("verified_stop", VerifiedStop(robot, params.verified_stop)),
        add("joint_servo", JointVelocityServo(robot, params.servo)),
    )
    connect(
        builder,
        (parts.path, "reference", parts.nmpc),
        (parts.nmpc, "velocity_commanded", parts.separation, parts.force_limit, parts.scaled),
        (fast, "dynamics", parts.servo),
    )
    for source, system, name in (
        (measured.position, parts.nmpc, "position_measured"),
        (measured.joint_state.position, fast, "position_measured"),
        (measured.joint_state.velocity, fast, "velocity_measured"),
        (measured.joint_state.position, envelope, "position_measured"),
        (parts.separation.GetOutputPort("speed_scale"), parts.choice, "scale_separation"),
        (parts.force_limit.GetOutputPort("speed_scale"), parts.choice, "scale_force"),
        (measured.position, parts.stop, "position_measured"),
        (parts.scaled.GetOutputPort("velocity_applied"), parts.stop, "velocity_commanded"),
        (parts.stop.GetOutputPort("velocity_applied"), envelope, "velocity_commanded"),
        (envelope.GetOutputPort("velocity_applied"), parts.servo, "velocity_commanded"),
    ):
        builder.Connect(source, system.GetInputPort(name))
    return parts


class ContactParts(NamedTuple):
    """What answers a touch."""

    observer: MomentumObserver
    window: TorqueWindow
    model_error: ModelErrorEstimator
    detector: ContactDetector
    localizer: ContactLocalizer
    monitor: ContactMonitor
    force: ContactForceEstimator
    controller: ContactImpedanceController


def add_contact(
    builder: DiagramBuilder, setup: CellSetup, measured: CellMeasurements, params: SafeCellParameters
) -> ContactParts:
    """Add observer, localizer and contact controller."""
    robot, add = setup.robot, builder.AddNamedSystem
    localizer = ContactLocalizer(
        robot, list(setup.cameras), params.localizer, list(setup.backgrounds), period=params.period
    )
    # The window tells the observer just what changes a difference of positions: no delay is left to tell.
    differenced, exact = params.observer.velocity_delay > 0.0, replace(params.observer, velocity_delay=0.0)
    observer = add("momentum_observer", MomentumObserver(robot, exact))
    parts = ContactParts(
        observer,
        add("torque_window", TorqueWindow(robot.n, params.envelope.period, params.period, differenced)),
        *add_contact_detection(builder, robot, observer, exact, params.model_error, params.detector),
        add("contact_localizer", localizer),
        add("contact_monitor", ContactMonitor(robot, params.monitor)),
        add("contact_force", ContactForceEstimator(robot, params.force)),
        add("contact_controller", ContactImpedanceController(robot, params.contact)),
    )
    connect(
        builder,
        (parts.model_error, "dynamics", parts.monitor, parts.force, parts.controller),
        (parts.model_error, "torque_external", parts.force, parts.localizer),
        (parts.model_error, "torque_noise", parts.localizer),
        (parts.observer, "friction_uncertainty", parts.force),
        (parts.observer, "friction_torque", parts.controller),
        (parts.detector, "contact", parts.monitor, parts.localizer),
        (parts.localizer, "contact_point", parts.monitor, parts.detector),
        (parts.localizer, "camera_status", parts.monitor),
        (parts.monitor, "interaction", parts.controller),
        (parts.force, "contact_force", parts.controller),
        (parts.force, "misfit", parts.controller),
    )
    builder.Connect(parts.window.GetOutputPort("torque_mean"), parts.observer.GetInputPort("torque_applied"))
    builder.Connect(parts.monitor.GetOutputPort("active_contact"), parts.force.GetInputPort("contact_point"))
    builder.Connect(measured.position, localizer.GetInputPort("position_measured"))
    several = len(setup.cameras) > 1
    for k, (image, time) in enumerate(measured.images):
        end = f"_{k}" if several else ""
        builder.Connect(image, localizer.GetInputPort(f"depth_image{end}"))
        builder.Connect(time, localizer.GetInputPort(f"image_time{end}"))
    return parts


class GuidingParts(NamedTuple):
    """What is led by skin and tool."""

    skin: SkinEstimator
    wrist: WristWrenchEstimator
    hold: HoldDetector
    controller: HandGuidingController


def add_guiding(
    builder: DiagramBuilder, setup: CellSetup, measured: CellMeasurements, params: SafeCellParameters
) -> GuidingParts:
    """Add estimators of skin and wrist, and the guiding."""
    robot, add = setup.robot, builder.AddNamedSystem
    acceleration = add("joint_acceleration", JointAcceleration(robot, params.period))
    parts = GuidingParts(
        add("skin_estimator", SkinEstimator(setup.layout, setup.calibration, params.skin)),
        add("wrist_wrench", WristWrenchEstimator(robot, params.wrist)),
        add("hold_detector", HoldDetector(params.signals)),
        add("guiding_controller", HandGuidingController(robot, params.guiding)),
    )
    connect(
        builder,
        (parts.wrist, "wrench_measured", parts.controller, parts.hold),
        (acceleration, "acceleration_measured", parts.wrist),
    )
    for source, system, name in (
        (measured.velocity, acceleration, "velocity_measured"),
        (measured.wrench, parts.wrist, "wrench_sensor"),
        (measured.voltages, parts.skin, "voltages"),
        (measured.sample_time, parts.skin, "sample_time"),
        (parts.skin.GetOutputPort("skin_reading"), parts.controller, "skin"),
        (parts.skin.GetOutputPort("skin_reading"), parts.hold, "skin"),
    ):
        builder.Connect(source, system.GetInputPort(name))
    return parts
