"""How well one random scene is localized: its frames played into the fusion, and the answer against the truth."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from experiments.localization.parameters import KINDS
from experiments.localization.particle_filter import contact_particle_filter
from experiments.localization.published import published_localization
from experiments.localization.pushes import torque_noise, wandering_forces
from experiments.localization.scenario import NEVER, ContactLocalizationScenario
from experiments.localization.scenes import ContactScenes, DrawnTouch
from saphari_drake.perception.camera.frames import instant
from saphari_drake.perception.contact.law import ContactFusionLaw
from saphari_drake.perception.contact.places import PlaceFinder
from saphari_drake.perception.contact.values import Fusion
from saphari_drake.robots.dynamics import DynamicsTerms
from saphari_drake.simulation.sensors.joint_sensor import JointSensorParameters, quantize
from saphari_drake.simulation.world.profile import PlantProfile
from saphari_drake.simulation.world.true_model import resting_residual

Array = NDArray[np.float64]

QUIET = 30  # frames without a touch, from which the residual's deviation is known


class Localizer(NamedTuple):
    """The law, and what finds places in the images of each camera."""

    law: ContactFusionLaw
    finders: list[PlaceFinder]


class Shown(NamedTuple):
    """One scene as the replay shows it: positions of the plant, and points and forces in the world (k, 3)."""

    positions: Array
    true: Array  # m
    found: Array  # m, NaN where nothing was found
    force: Array  # N, of the person on the robot
    felt: Array  # N, estimated


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
    particle_error: float  # m, of the contact particle filter
    particle_link_right: float
    particle_force_error: float
    other_weight: float
    size: float  # m, radius of what touches
    as_limb: float  # whether it was taken for a limb
    force: float  # N, its true size
    other_link: int  # that is touched at the same time (−1: none)
    camera_error: float = 0.0  # m, by which the first camera shows the contact beside itself
    camera_error_before: float = 0.0  # m, the same without its correction


METRES = {"size", *(name for name in Row._fields if name.endswith("error") and "force" not in name)}
METRES.add("camera_error_before")


def judged_scene(
    scenario: ContactLocalizationScenario,
    scenes: ContactScenes,
    localizer: Localizer,
    touches: list[DrawnTouch],
    images: list[NDArray[np.float32]],
    rng: np.random.Generator,
) -> tuple[list[Row], Shown]:
    """Play the frames of one scene into the localizer and compare its last answer with the truth of each touch."""
    p, first, law = scenario.scenes, touches[0], localizer.law
    moving = rng.random() < scenario.moving
    noise = torque_noise(rng, scenes.robot.n, scenario.frames, scenes.params)
    own = rng.spawn(1)[0]
    quiet = torque_noise(own, scenes.robot.n, QUIET, scenes.params)  # before anybody touches
    pushes = [wandering_forces(rng, touch, scenario.frames, scenes.params) for touch in touches]
    truth = scenario.truth(period=1.0)
    if truth.profile != PlantProfile():
        resting = resting_residual(scenes.robot, truth, first.q, rng)
        noise, quiet = noise + resting, quiet + resting
    sigma = np.sqrt(np.mean(quiet**2, axis=0))
    encoders = truth.joint_sensor(JointSensorParameters(position_resolution=0.0)).position_resolution
    memory, early, instants = law.empty(), [NEVER] * len(touches), []
    for k in range(scenario.frames):
        q = first.q + moving * first.v * k / scenario.cameras[0].rate
        exact = images if k == 0 or not moving else scenes.images(touches, q)
        terms = scenes.poses(q)
        forces = np.array([terms.R_WL[touch.link] @ push[k] for touch, push in zip(touches, pushes)])
        r = noise[k] + sum(terms.point(touch.link, touch.p_L).Jv_WC.T @ force for touch, force in zip(touches, forces))
        depth = [scenes.noisy(image, i, rng, touches) for i, image in enumerate(exact)]
        at = instant(scenes.robot, 0.0, quantize(q, encoders), r)._replace(sigma=sigma)
        instants.append(at)
        views = [finder.look(z, at.R_WL, at.p_WL, 2) for finder, z in zip(localizer.finders, depth)]
        evidence = law.evidence(at, views)
        memory = law.remember(memory, evidence)
        true = np.array([_in_world(terms, touch) for touch in touches])
        if k == 0:
            early = _matched(law.decide(memory), terms, true)[1].tolist()
    result = law.decide(memory)
    which, error = _matched(result, terms, true)
    vision = [_in_world(terms, place, place.p_LC) for place in evidence.seen]
    plain = published_localization(localizer.finders[0].camera, depth[0], terms, r, 3.0 * p.torque_noise)
    filtered = contact_particle_filter(scenes.robot, law.candidates, instants, sigma, law.params.friction, own)
    rows = []
    for k, touch in enumerate(touches):
        size, mode = float(np.linalg.norm(forces[k])), which[k]
        felt = result.forces[mode] if mode >= 0 else np.zeros(3)
        plain_error, filtered_error = (
            float(np.linalg.norm(_in_world(terms, found, found.p_L) - true[k])) if found.link >= 0 else NEVER
            for found in (plain, filtered)
        )
        rows.append(
            Row(
                link=touch.link,
                kind=KINDS.index(touch.kind),
                error=float(error[k]),
                link_right=float(mode >= 0 and result.modes[mode].link == touch.link),
                force_error=float(np.linalg.norm(felt - forces[k])) / size,
                first_error=float(early[k]),
                vision_error=min((float(np.linalg.norm(point - true[k])) for point in vision), default=np.nan),
                baseline_error=plain_error,
                baseline_link_right=float(plain.link == touch.link),
                baseline_force_error=float(np.linalg.norm(plain.F_W - forces[k])) / size,
                particle_error=filtered_error,
                particle_link_right=float(filtered.link == touch.link),
                particle_force_error=float(np.linalg.norm(filtered.F_W - forces[k])) / size,
                other_weight=result.second_weight,
                size=scenes.hands.size(touch.kind, touch.hand),
                as_limb=float(mode >= 0 and result.modes[mode].limb),
                force=size,
                other_link=touches[1 - k].link if len(touches) == 2 else -1,
            )
        )
    found = np.array([_in_world(terms, result.modes[m]) if m >= 0 else np.full(3, np.nan) for m in which])
    felt = np.array([result.forces[m] if m >= 0 else np.zeros(3) for m in which])
    return rows, Shown(scenes.positions(touches, q), true, found, forces, felt)


def _in_world(terms: DynamicsTerms, of, p_L: Array | None = None) -> Array:
    """Return a point of the link of a touch, a place or a mode in the world (m)."""
    return terms.p_WL[of.link] + terms.R_WL[of.link] @ (of.p_L if p_L is None else p_L)


def _matched(result: Fusion, terms: DynamicsTerms, true: Array) -> tuple[list[int], Array]:
    """Return, for each true point (k, 3), which contact found it (−1: none) and its error (k,) in m.

    Of two contacts both have to be found; of one, the first that the fusion gives counts.
    """
    count = len(true)
    if len(result.modes) < count:
        return [-1] * count, np.full(count, NEVER)
    points = np.array([_in_world(terms, mode) for mode in result.modes[:count]])
    error = np.linalg.norm(points[None] - true[:, None], axis=2)
    order = list(range(count))
    if count == 2 and error[0, 1] + error[1, 0] < error[0, 0] + error[1, 1]:
        order = [1, 0]
    return order, error[np.arange(count), order]
