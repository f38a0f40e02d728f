"""All faults by name: what each is, and what it acts on."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from saphari_drake.errors import ParameterError, UnknownNameError
from saphari_drake.parameters import require_non_negative, require_positive

PARTS = ("camera", "encoders", "torque", "controller", "plant", "skin", "wrist", "person", "view")
ARM = ("encoders", "torque", "controller", "plant")  # what every arm with torques has


class Fault(NamedTuple):
    """A fault: the part of an experiment that it acts on, what it is, and why nobody can tell it, if so, in a line."""

    part: str
    about: str
    bounded: str = ""


FAULTS = {
    "camera_dropout": Fault("camera", "no frame any more"),
    "camera_freeze": Fault("camera", "the same image in every frame, with fresh times"),
    "camera_delay": Fault("camera", "frames arrive late by fault_sizes.camera_delay"),
    "camera_blind": Fault("camera", "no reading in a patch in the middle of the image"),
    "camera_noise": Fault("camera", "noise of three times its size"),
    "camera_moved": Fault("camera", "the camera is pushed aside by fault_sizes.camera_shift"),
    "encoder_glitch": Fault("encoders", "one joint reads wrong for a moment"),
    "encoder_freeze": Fault("encoders", "one joint reads as at the start of the fault, without speed"),
    "encoder_nan": Fault("encoders", "one joint reads as not a number"),
    "torque_bias": Fault("torque", "a constant more in every joint"),
    "torque_noise": Fault("torque", "noise of three times that of the realistic plant", "its mean is zero"),
    "torque_stuck": Fault("torque", "one joint keeps its torque, whatever is commanded"),
    "controller_late": Fault("controller", "no new command for one cycle", "a cycle is what computers are late by"),
    "controller_late_10": Fault("controller", "no new command for ten cycles", "ten cycles of 1 or 2 ms may pass"),
    "controller_dead": Fault("controller", "no new command any more"),
    "payload": Fault(
        "plant",
        "a payload that nobody knows, from the beginning",
        "it acts as a push does, and is learned before anybody touches",
    ),
    "model_error": Fault(
        "plant",
        "mass and inertia of each link off by up to 10 %, from the beginning",
        "it acts as a push does, and is learned before anybody touches",
    ),
    "friction_double": Fault(
        "plant", "twice the friction of the realistic plant, from the beginning", "it acts as a push does"
    ),
    "skin_dead": Fault("skin", "a share of the skin's modules reads nothing"),
    "skin_lost": Fault("skin", "no sample of the skin any more"),
    "wrist_biased": Fault("wrist", "a constant more in each component of the wrist sensor"),
    "person_faster": Fault(
        "person",
        "the person moves at twice the speed, from the beginning",
        "no sensor knows how fast a person was meant to be",
    ),
    "person_unseen": Fault(
        "view", "the person comes in from outside of the view, at speed", "no sensor sees outside of the view"
    ),
}
STATIC = ("payload", "model_error", "friction_double", "person_faster")  # present from the beginning


@dataclass
class FaultSizes:
    """How large the faults are; all assumed."""

    # s; of camera_delay, and m; of camera_moved.
    camera_delay: float = 0.2
    camera_shift: float = 0.03
    # Share (0–1) of height and width that camera_blind takes.
    blind_share: float = 0.34
    # rad (m) and s; of encoder_glitch.
    glitch: float = 0.1
    glitch_time: float = 0.005
    # Nm (N of a prismatic joint, by its force limit over 100 N); of torque_bias.
    torque_bias: float = 1.0
    # Nm; noise of the realistic plant, of which torque_noise is thrice.
    torque_noise: float = 0.05
    # kg.
    payload: float = 1.0
    # Share (0–1); of model_error.
    model_error: float = 0.1
    # Share (0–1) of the modules that skin_dead takes.
    skin_share: float = 0.34
    # N and Nm; of wrist_biased.
    wrist_force: float = 5.0
    wrist_torque: float = 0.2
    # m and m/s; of person_unseen: from how far the person comes, and how fast.
    person_distance: float = 3.0
    person_speed: float = 2.0

    def __post_init__(self) -> None:
        require_positive(self, "glitch_time", "person_speed")
        require_non_negative(
            self, "camera_delay", "camera_shift", "blind_share", "glitch", "torque_bias", "torque_noise", "payload",
            "model_error", "skin_share", "wrist_force", "wrist_torque", "person_distance",
        )  # fmt: skip
        for name in ("blind_share", "model_error", "skin_share"):
            if getattr(self, name) >= 1.0:
                raise ParameterError(name, f"must lie below 1, got {getattr(self, name)}")


def possible(parts: Collection[str]) -> dict[str, Fault]:
    """Return the faults of an experiment that has these parts."""
    return {name: fault for name, fault in FAULTS.items() if fault.part in parts}


def require_faults(names: Sequence[str], parts: Collection[str]) -> None:
    """Demand faults that an experiment with these parts can have.

    Raises
    ------
    UnknownNameError
        Listing those that it can have.
    """
    for name in names:
        if name not in possible(parts):
            raise UnknownNameError("fault" if name not in FAULTS else "fault here", name, possible(parts))


def listed() -> str:
    """Return all faults with what they are, a line each."""
    width = max(len(name) for name in FAULTS)
    return "\n".join(f"  {name:<{width}}  {fault.part}: {fault.about}" for name, fault in FAULTS.items())
