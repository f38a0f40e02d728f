"""The table of hazards: what can hurt, the function against it, its limit, and the trials and tests that show it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from experiments.evidence.fault_trials import SOON, TRIALS, fastest, fault_summary, seconds
from experiments.evidence.readme_tables import NOTHING, table
from saphari_drake.estimation.wrench_check import WrenchCheckParameters
from saphari_drake.perception.camera.frame_check import FrameCheckParameters
from saphari_drake.perception.skin.estimator import SkinEstimatorParameters
from saphari_drake.safety.joint_check.parameters import JointCheckParameters
from saphari_drake.safety.joint_envelope.parameters import JointEnvelopeParameters
from saphari_drake.simulation.faults.registry import FAULTS

_JOINTS, _ENVELOPE, _FRAMES = JointCheckParameters(), JointEnvelopeParameters(), FrameCheckParameters()
_SKIN, _WRENCH = SkinEstimatorParameters(), WrenchCheckParameters()
HEAD = """# Hazards

Written by `diagrams/report.py` from the trials of `diagrams/faults.json`. Times count from the first effect above the
noise to the published safe state, the worst of all trials. A trial is `CASE FAULT`, each with {seeds} seeds. This is
evidence over named trials, no performance level and no failure rate.
"""


class Hazard(NamedTuple):
    """A row of the table: `faults` are its trials, `tests` files of the suite."""

    hazard: str
    function: str
    limit: str
    faults: tuple[str, ...]
    tests: tuple[str, ...]


HAZARDS = (
    Hazard(
        "a position is fed back that is not true",
        "`JointCheck`, brakes",
        f"{_JOINTS.encoder_tolerance:g} rad off the second encoder, {_JOINTS.speed_factor:g} times the speed limit",
        ("encoder_glitch", "encoder_freeze", "encoder_nan"),
        ("tests/safety/joint_check/test_law.py", "tests/safety/joint_check/test_system.py"),
    ),
    Hazard(
        "a drive gives another torque than it is asked for",
        "`JointCheck`, brakes",
        f"{_JOINTS.torque_tolerance:g} Nm on average over {seconds(_JOINTS.torque_time)}",
        ("torque_bias", "torque_stuck", "torque_noise"),
        ("tests/safety/joint_check/test_law.py",),
    ),
    Hazard(
        "a controller is late or dead",
        "`JointEnvelope` and `VelocityEnvelope`, hold",
        f"the same command for {seconds(_ENVELOPE.stale_time)} (velocities: 50 cycles) while the robot moves",
        ("controller_late", "controller_late_10", "controller_dead"),
        ("tests/safety/joint_envelope/test_system.py", "tests/safety/velocity_envelope/test_system.py"),
    ),
    Hazard(
        "a person is not seen, or elsewhere than thought, because the camera fails",
        "`ContactLocalizer` and `FrameCheck`, protective stop",
        f"{_FRAMES.blind_tiles} blind tiles, noise × {_FRAMES.noise_factor:g}, robot off by {_FRAMES.robot_offset:g} m",
        tuple(name for name, fault in FAULTS.items() if fault.part == "camera"),
        ("tests/perception/camera/test_frame_check.py", "tests/diagrams/experiments/contact/test_cell.py"),
    ),
    Hazard(
        "a hand on the skin is not felt",
        "`SkinEstimator`, brake and hold",
        f"{100 * (1.0 - _SKIN.least_usable):.0f} % of the modules dead, samples older than {seconds(_SKIN.timeout)}",
        ("skin_dead", "skin_lost"),
        ("tests/perception/skin/test_estimator.py",),
    ),
    Hazard(
        "a force is followed that nobody exerts",
        "`WrenchCheck`, brake and hold",
        f"{_WRENCH.tolerance:g} Nm of a joint between wrist and joints, for {seconds(_WRENCH.time)}",
        ("wrist_biased",),
        ("tests/estimation/test_wrench_check.py",),
    ),
    Hazard(
        "the robot is not the one of the model",
        "`ModelErrorEstimator`, `JointEnvelope`",
        "speed, torque and energy as for a robot that is known",
        ("payload", "model_error", "friction_double"),
        ("tests/estimation/test_model_error.py", "tests/safety/joint_envelope/test_law.py"),
    ),
    Hazard(
        "a person comes faster, or from where no camera sees",
        "`VerifiedStop`, `JointEnvelope`",
        "a stop is verified behind every command; of a torque interface: the joint speeds",
        ("person_faster", "person_unseen"),
        ("tests/safety/verified_stop/test_system.py",),
    ),
)


def hazards_text(recorded: Mapping[str, Any]) -> str:
    """Return the page of hazards, from what is recorded of the trials."""
    head = ("hazard", "function", "limit", "worst detection and reaction", "largest joint speed over its limit")
    rows = [
        (row.hazard, row.function, row.limit, *_measured(row, recorded), "<br>".join(f"`{test}`" for test in row.tests))
        for row in HAZARDS
    ]
    counts = [len(trials) for cases in recorded.values() for trials in cases.values()]
    seeds = f"{min(counts)} to {max(counts)}" if counts else "no"
    return HEAD.format(seeds=seeds) + "\n" + table((*head, "trials", "tests"), rows) + "\n"


def _measured(row: Hazard, recorded: Mapping[str, Any]) -> tuple[str, str, str]:
    """Return worst reaction, largest speed and trials of a row."""
    cases = {
        f"{trial.name} {fault}": fault_summary(recorded[fault][trial.name])
        for fault in row.faults
        for trial in TRIALS
        if trial.name in recorded.get(fault, {})
    }
    if not cases:
        return NOTHING, NOTHING, "not run yet"
    told = {name: entry for name, entry in cases.items() if entry["told"]}
    silent = [name for name, entry in cases.items() if entry["silent_seeds"] and not FAULTS[name.split()[-1]].bounded]
    bounded = [fault for fault in row.faults if FAULTS[fault].bounded]
    worst = max(told, key=lambda name: told[name]["reaction_max_s"], default="")
    said = [f"{seconds(told[worst]['reaction_max_s'])} ({worst})"] if worst else []
    said += [f"**later than {seconds(SOON)} or silent: {', '.join(silent)}**"] if silent else []
    said += [f"bounded, not told: {', '.join(bounded)}"] if bounded else []
    return "; ".join(said) or "no effect above the noise", fastest(cases), "<br>".join(f"`{name}`" for name in cases)
