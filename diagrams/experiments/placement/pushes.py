"""Where a person can push an arm so that joint torques show the force, and a camera the hand."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from experiments.placement.arm import PlacedArm
from saphari_drake.errors import ModelError
from saphari_drake.math.primitives import CAPSULE, CYLINDER, nearest_surface_point, surface_point
from saphari_drake.perception.camera.model import CameraParameters
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.simulation.people.pushing_hand import HumanHand, Push, find_target
from saphari_drake.simulation.world.hand import HandParameters

Array = NDArray[np.float64]
POINTS = 60  # surface points that are tried for each direction
SLANT = 0.35  # rad; a push is at most so far from the surface's normal, or the finger slips
ASIDE = 0.45  # rad; the finger comes at least so far from the camera's line of sight, which its fist would block
LEVER = 0.06  # m; least singular value of the contact's Jacobian over the reach's scale
MASS = 0.8  # kg; least effective mass along the push: below, the impedance lowers its gains
LOAD = 0.8  # share of the torque limits that gravity and push may take
FLOOR = 0.12  # m; least height of what is touched
YIELD = 0.06  # m; how far the arm yields to the push: 30 N over 500 N/m
FOLDS = 20.0  # what it costs a push that another link comes to the hand then
AXES = tuple(sign * axis for axis in np.eye(3) for sign in (-1.0, 1.0))


def side_camera(arm: PlacedArm, camera: CameraParameters) -> None:
    """Put a camera beside the arm, as far as its size asks for, at the height from which it looks down a little."""
    target, scale = arm.middle, float(np.clip(arm.scale, 0.6, 1.0))
    position = target + scale * (1.7 * arm.aside + np.array([0.0, 0.0, 0.5]))
    camera.position, camera.target = np.round(position, 3).tolist(), np.round(target, 3).tolist()


def push_on(
    arm: PlacedArm,
    camera: CameraParameters,
    hand: HandParameters,
    link: int,
    directions: Sequence[Array] = AXES,
    force: float = 30.0,
) -> Push | None:
    """Return the best push of a link (start and hold as by default), or None if there is none.

    It meets that link first, on a surface that faces it, where the contact's Jacobian has rank three with the least
    singular value as large as can be and the torque limits are kept; the camera sees finger and contact, and the hand
    touches nothing else, nor does it, if that can be had, when the arm has yielded by `YIELD`. A contact with an
    effective mass of `MASS` along the push goes before any that is lighter.
    """
    rng, best, chosen = np.random.default_rng([link, 17]), -np.inf, None
    for direction in directions:
        d = np.asarray(direction, dtype=float)
        for _ in range(POINTS):
            p_W, n_W = _facing_point(arm, link, d, rng)
            score = _felt(arm, camera, link, p_W, n_W, d, force)
            if score <= best:
                continue
            moved = yielded(arm, link, p_W, d)
            finger = _finger(arm, moved, camera, hand, p_W, n_W, d)
            if finger is None and score - FOLDS > best:
                score, finger = score - FOLDS, _finger(arm, arm, camera, hand, p_W, n_W, d)
            if finger is None:
                continue
            aim = np.round(arm.terms.in_link(link, p_W), 4).tolist()
            straight = np.allclose(finger, d)
            push = Push(arm.robot.link_names[link], aim, d.tolist(), [] if straight else finger.tolist(), force)
            if _meets(arm, push, p_W):
                best, chosen = score, push
    return chosen


def _facing_point(arm: PlacedArm, link: int, d: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return a surface point (m) of a link that about faces a push along d, and its outward normal, in the world."""
    shapes = arm.robot.shapes
    R_WS, p_WS = shapes.in_world(arm.terms.R_WL, arm.terms.p_WL)
    s = int(rng.choice(np.flatnonzero(shapes.link == link)))
    long = shapes.size[s, 1] if shapes.kind[s] in (CAPSULE, CYLINDER) else 0.0
    place = p_WS[s] + rng.uniform(-1.0, 1.0) * long * R_WS[s][:, 2]
    _, p_W, n_W = surface_point(
        shapes.kind[s], shapes.size[s], R_WS[s], p_WS[s], place - 0.4 * d + 0.05 * rng.normal(size=3)
    )
    return p_W, n_W


def _felt(arm: PlacedArm, camera: CameraParameters, link: int, p_W: Array, n_W: Array, d: Array, force: float) -> float:
    """How well a push at a point is felt, seen and answered, far better above `MASS`; −∞ if it is not."""
    facing = float(-n_W @ d)
    if facing < np.cos(SLANT) or p_W[2] < FLOOR:
        return -np.inf
    J = arm.terms.point(link, arm.terms.in_link(link, p_W)).Jv_WC
    least = float(np.linalg.svd(J, compute_uv=False)[2])
    if least < LEVER * arm.scale or np.any(np.abs(J.T @ d * force) + np.abs(arm.terms.g) > LOAD * arm.robot.tau_max):
        return -np.inf
    heavy = _mass(arm, J, d) >= MASS
    view = _view(camera, p_W)
    return least / arm.scale + 2.0 * facing + 0.5 * min(float(n_W @ view), 0.5) + (10.0 if heavy else 0.0)


def _view(camera: CameraParameters, p_W: Array) -> Array:
    """Unit direction from a point to the camera."""
    away = np.asarray(camera.position) - p_W
    return np.asarray(away / np.linalg.norm(away))


def yielded(arm: PlacedArm, link: int, p_W: Array, d: Array) -> PlacedArm:
    """Return the arm after a push at a point has moved it along d, each joint by what its inertia lets it."""
    terms = arm.terms
    J = terms.point(link, terms.in_link(link, p_W)).Jv_WC
    M_inv_JT = np.linalg.solve(terms.M, J.T)
    q = terms.q + M_inv_JT @ np.linalg.solve(J @ M_inv_JT, YIELD * d)
    return arm._replace(terms=evaluate_dynamics(arm.robot, q, np.zeros(arm.robot.n)))


def _finger(
    arm: PlacedArm, moved: PlacedArm, camera: CameraParameters, hand: HandParameters, p_W: Array, n_W: Array, d: Array
) -> Array | None:
    """Direction in which a finger points so that it is seen and the hand keeps clear, or None."""
    view = _view(camera, p_W)
    if n_W @ view < -0.2 or not _seen(arm, p_W + hand.finger_radius * n_W, view, camera):
        return None
    x = np.cross(d, [0.0, 0.0, 1.0] if abs(d[2]) < 0.9 else [1.0, 0.0, 0.0])
    y = np.cross(d, x)
    turned = [0.35 * d + np.cos(a) * x + np.sin(a) * y for a in np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)]
    for finger in [d, *sorted((t / np.linalg.norm(t) for t in turned), key=lambda t: float(abs(t @ view)))]:
        back = -finger
        tip = p_W + hand.finger_radius * n_W
        if (
            back @ n_W > 0.2
            and np.arccos(np.clip(back @ view, -1.0, 1.0)) > ASIDE
            and _hand_clear(arm, hand, tip, finger, d, (0.0, 0.5 * HumanHand.STANDOFF, HumanHand.STANDOFF))
            and (moved is arm or _hand_clear(moved, hand, tip + YIELD * d, finger, d, (0.0,)))
        ):
            return np.round(finger, 3)
    return None


def _seen(arm: PlacedArm, p_W: Array, view: Array, camera: CameraParameters) -> bool:
    """Whether nothing of the arm lies between a point and the camera."""
    away = float(np.linalg.norm(np.asarray(camera.position) - p_W))
    return all(_gap(arm, p_W + s * view) > 0.2 * min(s, 0.05) for s in np.linspace(0.03, away, 25))


def _gap(arm: PlacedArm, p_W: Array) -> float:
    shapes = arm.robot.shapes
    R_WS, p_WS = shapes.in_world(arm.terms.R_WL, arm.terms.p_WL)
    everything = np.ones(shapes.count, dtype=bool)
    return float(nearest_surface_point(shapes.kind, shapes.size, R_WS, p_WS, everything, p_W)[1])


def _hand_clear(
    arm: PlacedArm, hand: HandParameters, tip: Array, finger: Array, d: Array, backs: Sequence[float]
) -> bool:
    """Whether finger, fist and forearm keep clear of arm and floor, so far (m) on the way to the contact."""
    fist = hand.finger_length + 0.7 * hand.fist_radius
    parts = [(s, hand.finger_radius) for s in np.linspace(0.02, hand.finger_length, 4)]
    parts += [(fist + s, hand.forearm_radius) for s in np.linspace(0.0, hand.forearm_length, 5)]
    parts.append((fist, hand.fist_radius))
    for back in backs:
        for s, size in parts:
            centre = tip - s * finger - back * d
            if centre[2] < size + 0.02 or _gap(arm, centre) < size + min(0.02, 0.3 * (s + back)):
                return False
    return True


def _meets(arm: PlacedArm, push: Push, p_W: Array) -> bool:
    try:
        target = find_target(arm.robot, arm.robot.home, push)
    except ModelError:
        return False
    return bool(np.linalg.norm(target.p_WT - p_W) < 0.005)


def effective_mass(arm: PlacedArm, push: Push) -> float:
    """Return the effective mass (kg) of the arm at a push, along it."""
    J = arm.terms.point(arm.robot.link_index(push.link), np.asarray(push.aim, dtype=float)).Jv_WC
    d = np.asarray(push.direction, dtype=float)
    return _mass(arm, J, d / np.linalg.norm(d))


def _mass(arm: PlacedArm, J: Array, d: Array) -> float:
    return 1.0 / float(d @ J @ np.linalg.solve(arm.terms.M, J.T @ d))


def require_pushes(arm: PlacedArm, found: Sequence[Push | None], wanted: int, what: str) -> list[Push]:
    """Return the pushes that were found.

    Raises
    ------
    ModelError
        If there are fewer than wanted.
    """
    pushes = [push for push in found if push is not None]
    if len(pushes) < wanted:
        raise ModelError(
            f"{arm.robot.name}: {len(pushes)} of {wanted} {what} found at its home posture where torques show a force "
            "of 30 N in three directions within the limits and the camera sees the hand"
        )
    return pushes
