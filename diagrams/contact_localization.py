"""Random touches of the arm, seen and hidden: where and how hard, from depth cameras and joint torques (Section 7)."""

from __future__ import annotations

import sys

import numpy as np
from experiments.localization.calibration import corrections, displaced, robot_alone
from experiments.localization.judge import METRES, Localizer, Row, Shown, judged_scene
from experiments.localization.report import figure, metrics, replay
from experiments.localization.scenario import (
    CASES,
    TWO,
    ContactLocalizationScenario,
    believed_cameras,
    build_scenes,
    scenario_for,
)
from experiments.localization.scenes import ContactScenes, DrawnTouch
from experiments.placement.scenes import place_scenes
from pydrake.math import RigidTransform
from pydrake.systems.framework import Diagram

from saphari_drake.errors import ParameterError
from saphari_drake.perception.contact.law import ContactFusionLaw
from saphari_drake.perception.contact.places import PlaceFinder
from saphari_drake.perception.segmentation.background import background_depth
from saphari_drake.perception.segmentation.robot_filter import RobotFilter
from saphari_drake.simulation.record.log import Log
from saphari_drake.simulation.runner.experiment import Experiment, main
from saphari_drake.simulation.runner.results import Outcome
from saphari_drake.simulation.runner.simulation import RunOptions

SHOWN = 15  # scenes of the replay


def build_diagram(scenario: ContactLocalizationScenario) -> Diagram:
    """Return the diagram that renders the scenes."""
    return build_scenes(scenario).diagram


def drawn_touches(case: str, scenes: ContactScenes, rng: np.random.Generator, index: int) -> list[DrawnTouch] | None:
    """Draw the touches of scene `index`; nothing if there is no room for two."""
    kinds = scenes.hands.kinds
    links = [link for link in range(1, scenes.robot.n) if np.any(scenes.robot.shapes.link == link)]
    if case not in TWO:
        return [scenes.draw(rng, links[index % len(links)], kinds[(index // len(links)) % len(kinds)])]
    pairs = [(a, b) for b in links for a in links if a < b]
    inner, outer = pairs[index % len(pairs)]
    chosen = kinds[index % len(kinds)], kinds[(index // len(kinds)) % len(kinds)]
    try:
        first = scenes.draw(rng, outer, chosen[0])
        second = scenes.draw(rng, inner, chosen[1], first.q, first)
    except ParameterError:
        return None  # the posture leaves no room: another one is drawn
    same = scenes.hands.body(first.kind) == scenes.hands.body(second.kind) and first.hand == second.hand
    return None if same else [first, second]


def wanted(case: str, seen: list[bool]) -> bool:
    """Whether a scene is of the case's kind, by whether the first camera sees each contact."""
    if case == "two_cameras":
        return True
    return not any(seen) if case == "hidden" else all(seen)


def run(scenario: ContactLocalizationScenario, options: RunOptions) -> Outcome:
    """Draw scenes until enough are of the case's kind, localize each and judge."""
    scenes, case = build_scenes(scenario), scenario.case
    rng = np.random.default_rng([scenario.seed, 1])
    backgrounds = [
        background_depth(scenes.background(k, rng), scenario.localizer) for k in range(len(scenario.cameras))
    ]
    law, alone = ContactFusionLaw(scenes.robot, scenario.fusion), robot_alone(scenario, scenes)
    rows: list[Row] = []
    shown: list[Shown] = []
    drawn = count = 0
    while count < scenario.count and drawn < 20 * scenario.count:
        rng = np.random.default_rng([scenario.seed, 2, drawn])
        touches = drawn_touches(case, scenes, rng, count)
        drawn += 1
        if touches is None:
            continue
        images = scenes.images(touches, touches[0].q)
        if not wanted(case, [scenes.visible(images[0], 0, touch) for touch in touches]):
            continue
        believed = believed_cameras(scenario, rng)
        corrected = corrections(scenario, scenes, alone, believed, rng)
        filters = [
            RobotFilter(scenes.robot.shapes, camera, scenario.localizer, background).corrected(X_correct)
            for camera, background, X_correct in zip(believed, backgrounds, corrected)
        ]
        localizer = Localizer(law, [PlaceFinder(camera, scenario.localizer) for camera in filters])
        judged, picture = judged_scene(scenario, scenes, localizer, touches, images, rng)
        p_W = scenes.contact(touches[0])
        pose = displaced(scenario.cameras[0], believed[0], corrected[0], p_W)
        before = displaced(scenario.cameras[0], believed[0], RigidTransform(), p_W)
        rows += [row._replace(camera_error=pose, camera_error_before=before) for row in judged]
        shown += [picture] if count < SHOWN else []
        count += 1
        if sys.stderr.isatty():
            print(f"\r{case} scene {count} of {scenario.count}\x1b[K", end="", file=sys.stderr)
    if sys.stderr.isatty():
        print(file=sys.stderr)
    log = Log(np.arange(len(rows), dtype=float))
    for name in Row._fields:
        log.add(name, [getattr(row, name) for row in rows], "m" if name in METRES else "1")
    return Outcome(
        metrics(scenario, scenes.robot, log, drawn),
        log,
        lambda: figure(scenario, log),
        lambda path: replay(scenario, scenes, shown, path),
    )


def quick(scenario: ContactLocalizationScenario) -> None:
    """Take a few scenes."""
    scenario.count = min(scenario.count, SHOWN)


EXPERIMENT = Experiment(
    "contact_localization",
    __doc__,
    CASES,
    scenario_for,
    run,
    build_diagram,
    adapt=place_scenes,
    parts=lambda case: ("plant",),
    quick=quick,
)


if __name__ == "__main__":
    sys.exit(main(EXPERIMENT))
