"""Random touches of the arm, seen and hidden: where and how hard, from depth cameras and joint torques (Section 7)."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RotationMatrix
from pydrake.systems.framework import Diagram

from saphari_drake.perception.fusion import ContactFusionLaw, Fusion, FusionParameters
from saphari_drake.perception.localization import ContactVision, LocalizerParameters, background_depth
from saphari_drake.perception.rgbd_camera import CameraParameters
from saphari_drake.robots import catalog
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.contact_scenes import KINDS, ContactScenes, SceneParameters, Touch
from saphari_drake.simulation.experiment import Experiment, Log, Metric, Outcome, RunOptions, main
from saphari_drake.simulation.figures import BOUND, CYCLE, blank, legend
from saphari_drake.simulation.published_localization import published_localization

Array = NDArray[np.float64]

CASES = {
    "one_camera": "one camera that sees the contact",
    "two_cameras": "two cameras, all contacts, seen or not",
    "miscalibrated": "one camera that sees the contact, its pose wrong by 5 mm and 0.3°",
    "hidden": "one camera that does not see the contact; 0.05 Nm of torque noise, eight frames",
}
NEVER = 1.0  # m; error of a contact that was not found


@dataclass
class ContactLocalizationScenario:
    """Everything a run depends on."""

    case: str = "one_camera"
    # Seed of everything random.
    seed: int = 0
    # s; not used: scenes have no time.
    duration: float = 1.0
    # Catalog name, or path of a URDF or SDF.
    robot: str = "lwr4"
    # Number of scenes (≥ 1), and frames of each; the last one is judged.
    count: int = 204
    frames: int = 8
    # Share of the scenes in which the robot moves.
    moving: float = 0.0
    # m and deg; error of the camera's pose that the localizer does not know of.
    extrinsic_shift: float = 0.0
    extrinsic_turn: float = 0.0
    cameras: list[CameraParameters] = field(default_factory=lambda: [CameraParameters()])
    scenes: SceneParameters = field(default_factory=SceneParameters)
    localizer: LocalizerParameters = field(default_factory=LocalizerParameters)
    fusion: FusionParameters = field(default_factory=FusionParameters)


def scenario_for(case: str) -> ContactLocalizationScenario:
    """Return the scenario of a case."""
    scenario = ContactLocalizationScenario(case=case)
    if case == "two_cameras":
        scenario.cameras.append(CameraParameters(position=[1.2, 1.4, 1.2]))
    if case == "miscalibrated":
        scenario.extrinsic_shift, scenario.extrinsic_turn = 0.005, 0.3
    if case == "hidden":
        scenario.scenes.torque_noise = scenario.fusion.torque_sigma = 0.05
    return scenario


class Row(NamedTuple):
    """One judged scene."""

    link: int
    kind: int
    error: float  # m
    link_right: float
    force_error: float
    first_error: float  # m, after the first frame
    vision_error: float  # m, of the cameras alone; NaN: they see nothing near
    baseline_error: float  # m
    baseline_link_right: float
    baseline_force_error: float
    other_weight: float
    size: float  # m, radius of what touches


def build_scenes(scenario: ContactLocalizationScenario) -> ContactScenes:
    """Return robot, hands and cameras."""
    return ContactScenes(catalog.load(scenario.robot), scenario.cameras, scenario.scenes, scenario.seed)


def build_diagram(scenario: ContactLocalizationScenario) -> Diagram:
    """Return the diagram that renders the scenes."""
    return build_scenes(scenario).diagram


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


def run(scenario: ContactLocalizationScenario, options: RunOptions) -> Outcome:
    """Draw scenes until enough are of the case's kind, localize each and judge."""
    scenes = build_scenes(scenario)
    rng = np.random.default_rng([scenario.seed, 1])
    visions = []
    for k in range(len(scenario.cameras)):
        background = background_depth(scenes.background(k, rng), scenario.localizer)
        visions.append((scenario.cameras[k], background))
    law = ContactFusionLaw(scenes.robot, [], scenario.fusion)
    rows: list[Row] = []
    drawn = 0
    while len(rows) < scenario.count and drawn < 8 * scenario.count:
        rng = np.random.default_rng([scenario.seed, 2, drawn])
        link, kind = 1 + len(rows) % (scenes.robot.n - 1), KINDS[(len(rows) // (scenes.robot.n - 1)) % len(KINDS)]
        touch = scenes.draw(rng, link, kind)
        drawn += 1
        images = scenes.images([touch], touch.q)
        seen = scenes.visible(images[0], 0, touch, touch.q)
        if (scenario.case == "hidden" and seen) or (scenario.case in ("one_camera", "miscalibrated") and not seen):
            continue
        believed = believed_cameras(scenario, rng)
        used = [
            ContactVision(scenes.robot.shapes, camera, scenario.localizer, background)
            for camera, (_, background) in zip(believed, visions)
        ]
        law.visions = tuple(used)
        rows.append(judged_scene(scenario, scenes, law, touch, images, rng))
        if sys.stderr.isatty():
            print(f"\r{scenario.case} scene {len(rows)} of {scenario.count}\x1b[K", end="", file=sys.stderr)
    if sys.stderr.isatty():
        print(file=sys.stderr)
    log = Log(np.arange(len(rows), dtype=float))
    units = {"error": "m", "first_error": "m", "vision_error": "m", "baseline_error": "m", "size": "m"}
    for name in Row._fields:
        log.add(name, [getattr(row, name) for row in rows], units.get(name, "1"))
    return Outcome(metrics(scenario, scenes.robot, log, drawn), log, lambda: figure(scenario, log))


def judged_scene(
    scenario: ContactLocalizationScenario,
    scenes: ContactScenes,
    law: ContactFusionLaw,
    touch: Touch,
    images: list[NDArray[np.float32]],
    rng: np.random.Generator,
) -> Row:
    """Play the frames of one scene into the localizer and compare its last answer with the truth."""
    p = scenario.scenes
    moving = rng.random() < scenario.moving
    noise = scenes.torque_noise(rng, scenario.frames)
    forces = scenes.forces(rng, touch, scenario.frames)
    memory, first_error = law.empty(), NEVER
    for k in range(scenario.frames):
        q = touch.q + moving * touch.v * k / scenario.cameras[0].rate
        exact = images if k == 0 or not moving else scenes.images([touch], q)
        terms = scenes.poses(q)
        F = terms.R_WL[touch.link] @ forces[k]
        r = terms.point(touch.link, touch.p_L).Jv_WC.T @ F + noise[k]
        depth = [scenes.noisy(image, i, rng) for i, image in enumerate(exact)]
        evidence = law.evidence(q, r, depth)
        memory = law.remember(memory, evidence)
        if k == 0:
            first_error = error_of(law.decide(memory), terms, touch)
    result = law.decide(memory)
    true = terms.p_WL[touch.link] + terms.R_WL[touch.link] @ touch.p_L
    vision_error = np.nan
    if evidence.seen:
        place = min(evidence.seen, key=lambda entry: entry.distance)
        vision_error = float(np.linalg.norm(terms.p_WL[place.link] + terms.R_WL[place.link] @ place.p_LC - true))
    plain = published_localization(law.visions[0], depth[0], terms, r, 3.0 * p.torque_noise)
    plain_error = NEVER
    if plain.link >= 0:
        plain_error = float(np.linalg.norm(terms.p_WL[plain.link] + terms.R_WL[plain.link] @ plain.p_L - true))
    size = float(np.linalg.norm(F))
    force = result.forces[0] if len(result.forces) else np.zeros(3)
    return Row(
        link=touch.link,
        kind=KINDS.index(touch.kind),
        error=error_of(result, terms, touch),
        link_right=float(bool(result.modes) and result.modes[0].link == touch.link),
        force_error=float(np.linalg.norm(force - F)) / size,
        first_error=first_error,
        vision_error=vision_error,
        baseline_error=plain_error,
        baseline_link_right=float(plain.link == touch.link),
        baseline_force_error=float(np.linalg.norm(plain.F_W - F)) / size,
        other_weight=result.second_weight,
        size=float(scenes.sizes[touch.hand][[0, 2, 3][KINDS.index(touch.kind)]]),
    )


def error_of(result: Fusion, terms, touch: Touch) -> float:
    """Return the distance (m) of the found contact from the true one."""
    if not result.modes:
        return NEVER
    mode = result.modes[0]
    found = terms.p_WL[mode.link] + terms.R_WL[mode.link] @ mode.p_L
    return float(np.linalg.norm(found - terms.p_WL[touch.link] - terms.R_WL[touch.link] @ touch.p_L))


def metrics(scenario: ContactLocalizationScenario, robot: RobotModel, log: Log, drawn: int) -> list[Metric]:
    """Return the metrics of the contract, those by link and by what touches, and the baseline's."""
    column = {name: log[name][:, 0] for name in log}
    error, case = column["error"], scenario.case
    high = {"one_camera": 0.006, "miscalibrated": 0.010, "hidden": 0.015}.get(case, np.inf)
    tail = {"one_camera": 0.020, "hidden": 0.150}.get(case, np.inf)
    result = [
        Metric("median_m", np.median(error), "m", high=high),
        Metric("p95_m", np.percentile(error, 95), "m", high=tail),
        Metric("within_20mm", np.mean(error < 0.02), "1", low=0.90 if case == "two_cameras" else -np.inf),
        Metric("link_correct", column["link_right"].mean(), "1", low=0.97 if case == "one_camera" else -np.inf),
        Metric("force_error_relative_median", np.median(column["force_error"]), "1"),
        Metric("first_frame_median_m", np.median(column["first_error"]), "m"),
        Metric("first_frame_p95_m", np.percentile(column["first_error"], 95), "m"),
    ]
    for link in range(1, robot.n):
        rows = column["link"] == link
        name = robot.link_names[link]
        if rows.any():
            result += [
                Metric(f"{name}_median_m", np.median(error[rows]), "m"),
                Metric(f"{name}_p95_m", np.percentile(error[rows], 95), "m"),
                Metric(f"{name}_within_20mm", np.mean(error[rows] < 0.02), "1"),
                Metric(f"{name}_link_correct", column["link_right"][rows].mean(), "1"),
                Metric(f"{name}_force_error_relative_median", np.median(column["force_error"][rows]), "1"),
            ]
    for k, kind in enumerate(KINDS):
        rows = column["kind"] == k
        if rows.any():
            result.append(Metric(f"{kind}_median_m", np.median(error[rows]), "m"))
            result.append(Metric(f"{kind}_p95_m", np.percentile(error[rows], 95), "m"))
            result.append(Metric(f"{kind}_radius_least_m", column["size"][rows].min(), "m"))
            result.append(Metric(f"{kind}_radius_most_m", column["size"][rows].max(), "m"))
    plain = column["baseline_error"]
    return [
        *result,
        Metric("baseline_median_m", np.median(plain), "m"),
        Metric("baseline_p95_m", np.percentile(plain, 95), "m"),
        Metric("baseline_within_20mm", np.mean(plain < 0.02), "1"),
        Metric("baseline_link_correct", column["baseline_link_right"].mean(), "1"),
        Metric("baseline_force_error_relative_median", np.median(column["baseline_force_error"]), "1"),
        Metric("ambiguous_share", np.mean(column["other_weight"] > 0.1), "1"),
        Metric("scenes", len(error), "1", low=min(200, scenario.count)),
        Metric("scenes_drawn", drawn, "1"),
    ]


def figure(scenario: ContactLocalizationScenario, log: Log):
    """Return histograms of the error, ours and the published method's, and the error by link."""
    result, axes = blank(2, 1, f"Contact localization, {CASES[scenario.case]}", (7.5, 6.0))
    bins = np.geomspace(0.5, 1000.0, 34)
    error, plain = 1e3 * log["error"][:, 0], 1e3 * log["baseline_error"][:, 0]
    top, bottom = axes[0, 0], axes[1, 0]
    top.hist(np.clip(plain, bins[0], bins[-1]), bins, color=CYCLE[1], alpha=0.5, label="published method")
    top.hist(np.clip(error, bins[0], bins[-1]), bins, color=CYCLE[0], alpha=0.7, label="this localizer")
    top.axvline(20.0, color=BOUND, linestyle="--", linewidth=0.9, label="20 mm")
    top.set_xscale("log")
    top.set_title("Error of the contact point (1000 mm: nothing found)", loc="left")
    top.set_xlabel("error [mm]")
    top.set_ylabel("scenes")
    legend(top)
    rng = np.random.default_rng(0)
    for k, kind in enumerate(KINDS):
        rows = log["kind"][:, 0] == k
        x = log["link"][rows, 0] + 1.0 + 0.22 * (k - 1) + rng.uniform(-0.07, 0.07, rows.sum())
        bottom.plot(x, np.clip(error[rows], 0.5, 1000.0), ".", color=CYCLE[k], markersize=4, label=kind)
    for link in np.unique(log["link"][:, 0]):
        median = np.median(error[log["link"][:, 0] == link])
        bottom.plot([link + 0.6, link + 1.4], [median, median], color="black", linewidth=1.2)
    bottom.set_yscale("log")
    bottom.set_title("Error by link and by what touches; bars: medians", loc="left")
    bottom.set_xlabel("link")
    bottom.set_ylabel("error [mm]")
    legend(bottom)
    return result


EXPERIMENT = Experiment(
    name="contact_localization",
    summary=__doc__,
    cases=CASES,
    scenario_for=scenario_for,
    run=run,
    build_diagram=build_diagram,
    accepts_model=True,
)

if __name__ == "__main__":
    sys.exit(main(EXPERIMENT))
