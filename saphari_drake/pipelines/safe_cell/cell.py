"""The safe cell: from measured ports to `torque_applied`, under one supervisor."""

from dataclasses import replace
from typing import NamedTuple

from pydrake.systems.framework import DiagramBuilder, OutputPort

from saphari_drake.control.contact.system import ContactImpedanceController
from saphari_drake.control.hand_guiding.system import HandGuidingController
from saphari_drake.control.nmpc.parameters import NmpcStatus
from saphari_drake.control.nmpc.system import NmpcController
from saphari_drake.messages import CameraStatus, SkinStatus, SystemStatus
from saphari_drake.perception.obstacles.merge import MergedObstacles
from saphari_drake.pipelines.envelope import JointState, add_joint_check, add_joint_envelope
from saphari_drake.pipelines.safe_cell.job_path import JobPath
from saphari_drake.pipelines.safe_cell.parameters import CellMeasurements, CellSetup, SafeCellParameters
from saphari_drake.pipelines.safe_cell.parts import add_contact, add_guiding, add_job, add_people
from saphari_drake.pipelines.safe_cell.signals import (
    FaultGate,
)
from saphari_drake.robots.dynamics import RobotDynamics
from saphari_drake.safety.command_switch import CommandSwitch
from saphari_drake.safety.contact_detector import ContactDetector
from saphari_drake.safety.contact_monitor import ContactMonitor
from saphari_drake.safety.joint_envelope.law import EnvelopeStatus
from saphari_drake.safety.joint_envelope.system import JointEnvelope
from saphari_drake.safety.power_force.system import PowerForceLimit
from saphari_drake.safety.speed_separation.system import SpeedSeparation
from saphari_drake.safety.supervisor.system import Supervisor, TorqueChoice
from saphari_drake.systems import connect

# Statuses that are faults, by the names of the supervisor's reasons. A camera that sees too little is none: people are
# lost then, and the robot waits.
BROKEN = {
    "camera": (CameraStatus.STALE,),
    "skin": (SkinStatus.LOST,),
    "joint state": (SystemStatus.BRAKES_ON,),
    "controller": (NmpcStatus.BAD_INPUT, NmpcStatus.UNSOLVED),
    "joint envelope": (EnvelopeStatus.BRAKING, EnvelopeStatus.BAD_INPUT),
}


class SafeCell(NamedTuple):
    """The systems that others look at."""

    job: JobPath
    nmpc: NmpcController
    people: MergedObstacles
    separation: SpeedSeparation
    force_limit: PowerForceLimit
    supervisor: Supervisor
    detector: ContactDetector
    monitor: ContactMonitor
    contact: ContactImpedanceController
    guiding: HandGuidingController
    switch: CommandSwitch
    envelope: JointEnvelope

    @property
    def torque_output(self) -> OutputPort:
        """Joint torque, n (Nm or N)."""
        return self.envelope.GetOutputPort("torque_applied")


def add_safe_cell(
    builder: DiagramBuilder, setup: CellSetup, measured: CellMeasurements, params: SafeCellParameters | None = None
) -> SafeCell:
    """Add all systems of the safe cell, and connect them.

    Joint states, checked → all. Cameras → people → monitors and predictive controller; its velocity, as far as the
    supervisor lets it, → verified stop → velocity envelope → servo. Residual, cameras → contact controller. Skin, wrist
    sensor → guiding. The supervisor names the torque that passes → command switch → joint envelope. `recover` of the
    supervisor is left to connect.
    """
    params = params or SafeCellParameters()
    params.__post_init__()
    params.supervisor.fault_names = list(BROKEN)
    robot, add, witness = setup.robot, builder.AddNamedSystem, measured.witness
    state, own = JointState(measured.position, measured.velocity), replace(params.check, period=params.envelope.period)
    held = add_joint_check(builder, robot, state, replace(params.check, period=params.period), witness)
    fast = add_joint_check(builder, robot, measured.joint_state, own, witness, "own_joint_check")
    measured = measured._replace(position=held.state.position, velocity=held.state.velocity, joint_state=fast.state)
    dynamics = add("dynamics", RobotDynamics(robot))
    for port, name in ((measured.position, "position_measured"), (measured.velocity, "velocity_measured")):
        builder.Connect(port, dynamics.GetInputPort(name))
    people = add_people(builder, setup, measured, params)
    supervisor = add("supervisor", Supervisor(params.supervisor))
    job = add_job(builder, setup, measured, params)
    contact = add_contact(builder, setup, measured, params)
    guiding = add_guiding(builder, setup, measured, params)
    choice, gate = add("torque_choice", TorqueChoice(robot.n)), add("fault_gate", FaultGate(BROKEN, params.signals))
    switch = add("command_switch", CommandSwitch(robot, params.switch))
    envelope = add_joint_envelope(
        builder, robot, switch, contact.observer.GetOutputPort("torque_external"), held.state, fast.state,
        params.envelope, params.period,
    )  # fmt: skip
    for checked in (held, fast):
        checked.close(builder, envelope.GetOutputPort("torque_acting"), witness)
    connect(
        builder,
        (dynamics, "dynamics", job.path, job.separation, job.force_limit, contact.observer, contact.model_error,
         guiding.wrist),
        (contact.model_error, "dynamics", guiding.controller, switch),
        (supervisor, "speed_limit", job.path, job.scaled),
        (supervisor, "source", choice),
        (supervisor, "selection", switch),
        (job.choice, "speed_scale", supervisor),
        (guiding.hold, "taken", supervisor),
        (gate, "faults", supervisor),
        (choice, "torque_commanded", switch),
    )  # fmt: skip
    for source, port, target, name in (
        (people, "obstacles", job.nmpc, "obstacles"),
        (people, "obstacles", job.separation, "people"),
        (people, "obstacles", job.force_limit, "people"),
        (people, "obstacles", job.stop, "people"),
        (contact.detector, "contact", supervisor, "touched"),
        (contact.controller, "selection", supervisor, "contact_selection"),
        (job.servo, "torque_commanded", choice, "torque_job"),
        (contact.controller, "torque_commanded", choice, "torque_contact"),
        (guiding.controller, "torque_commanded", choice, "torque_guiding"),
        (envelope, "torque_acting", contact.window, "torque_acting"),
        (envelope, "torque_applied", job.servo, "torque_applied"),
        (contact.localizer, "camera_status", gate, "camera"),
        (guiding.skin, "skin_status", gate, "skin"),
        (switch, "system_status", gate, "joint state"),
        (job.nmpc, "status", gate, "controller"),
        (envelope, "status", gate, "joint envelope"),
    ):
        builder.Connect(source.GetOutputPort(port), target.GetInputPort(name))
    return SafeCell(
        job.path, job.nmpc, people, job.separation, job.force_limit, supervisor, contact.detector, contact.monitor,
        contact.controller, guiding.controller, switch, envelope,
    )  # fmt: skip
