"""What a run of the contact localization depends on."""

from dataclasses import dataclass, field

import numpy as np
from pydrake.math import RotationMatrix

from experiments.localization.parameters import SceneParameters
from experiments.localization.scenes import ContactScenes
from saphari_drake.errors import ParameterError
from saphari_drake.parameters import require_non_negative, require_positive
from saphari_drake.perception.camera.check_parameters import CameraCheckParameters
from saphari_drake.perception.camera.model import CameraParameters
from saphari_drake.perception.contact.law import FusionParameters
from saphari_drake.perception.contact.parameters import LocalizerParameters
from saphari_drake.simulation.runner.plant_scenario import PlantScenario

CASES = {
    "one_camera": "one camera that sees the contact",
    "two_cameras": "two cameras, all contacts, seen or not",
    "miscalibrated": "one camera that sees the contact, its pose wrong by 5 mm and 0.3° before it sees the robot",
    "hidden": "one camera that does not see the contact; 0.05 Nm of torque noise, eight frames",
    "two_contacts": "two hands at once on two links, one camera that sees both",
    "measured_people": "one camera that sees the contact; hands, sleeves and bodies of many sizes, none as assumed",
    "force_range": "two hands at once, forces from 3 to 80 N, uniform in their logarithm",
}
TWO = ("two_contacts", "force_range")  # with two hands
BANDS = (3.0, 10.0, 40.0, 80.0)  # N; between each two, the error of the force is given for itself
NEVER = 1.0  # m; error of a contact that was not found


@dataclass
class ContactLocalizationScenario(PlantScenario):
    """Everything a run depends on; scenes have no time, so that `duration` is not used."""

    case: str = "one_camera"
    # deg; posture about which the robot is drawn. Empty: the model's own home posture.
    home: list[float] = field(default_factory=list)
    # Number of scenes (≥ 1), and frames of each (≥ 1); the last one is judged.
    count: int = 204
    frames: int = 8
    # Share of the scenes in which the robot moves (0–1).
    moving: float = 0.0
    # m and deg; error of the camera's pose that the localizer does not know of.
    extrinsic_shift: float = 0.0
    extrinsic_turn: float = 0.0
    # Postures of the robot alone by which each camera is checked and corrected before the touch (≥ 0; 0: it is not).
    checked: int = 0
    cameras: list[CameraParameters] = field(default_factory=lambda: [CameraParameters()])
    scenes: SceneParameters = field(default_factory=SceneParameters)
    localizer: LocalizerParameters = field(default_factory=LocalizerParameters)
    fusion: FusionParameters = field(default_factory=FusionParameters)
    check: CameraCheckParameters = field(default_factory=CameraCheckParameters)

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "count", "frames")
        require_non_negative(self, "moving", "extrinsic_shift", "extrinsic_turn", "checked")
        if self.moving > 1.0:
            raise ParameterError("moving", f"must not exceed 1, got {self.moving}")
        if not self.cameras:
            raise ParameterError("cameras", "needs at least one camera")


def scenario_for(case: str) -> ContactLocalizationScenario:
    """Return the scenario of a case."""
    scenario = ContactLocalizationScenario(case=case)
    if case == "two_cameras":
        scenario.cameras.append(CameraParameters(position=[1.2, 1.4, 1.2]))
    if case == "miscalibrated":
        scenario.extrinsic_shift, scenario.extrinsic_turn = 0.005, 0.3
        scenario.checked = 4
    if case == "hidden":
        scenario.scenes.torque_noise = 0.05
    if case in TWO:
        scenario.count = 105
    if case == "measured_people":
        scenario.count = 408  # 68 of each kind
        scenario.scenes.people, scenario.scenes.sleeve_sigma = "measured", 0.004
    if case == "force_range":
        scenario.scenes.force, scenario.scenes.force_drawn = [BANDS[0], BANDS[-1]], "logarithm"
    return scenario


def build_scenes(scenario: ContactLocalizationScenario) -> ContactScenes:
    """Return robot, hands and cameras."""
    robot = scenario.known(scenario.loaded(scenario.home))
    return ContactScenes(robot, scenario.cameras, scenario.scenes, scenario.seed)


def believed_cameras(scenario: ContactLocalizationScenario, rng: np.random.Generator) -> list[CameraParameters]:
    """Return the cameras as the localizer takes them to be: where they are, or off by the extrinsic error."""
    believed = []
    for camera in scenario.cameras:
        shift = rng.normal(size=3)
        shift *= scenario.extrinsic_shift / np.linalg.norm(shift)
        axis = rng.normal(size=3)
        turn = np.deg2rad(scenario.extrinsic_turn) * axis / np.linalg.norm(axis)
        R = np.eye(3) + np.array([[0, -turn[2], turn[1]], [turn[2], 0, -turn[0]], [-turn[1], turn[0], 0]])
        R = RotationMatrix.ProjectToRotationMatrix(R).matrix()
        position = np.asarray(camera.position) + shift
        target = position + R @ (np.asarray(camera.target) - np.asarray(camera.position))
        values = {name: getattr(camera, name) for name in camera.__dataclass_fields__}
        believed.append(CameraParameters(**{**values, "position": position.tolist(), "target": target.tolist()}))
    return believed
