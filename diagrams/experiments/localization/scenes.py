"""Random still lifes of a person touching the robot: what cameras and joint torques show of them, and the truth."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import Capsule, SceneGraph
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.framework import Diagram, DiagramBuilder

from experiments.localization.hands import Hands
from experiments.localization.parameters import SceneParameters, room_depth
from experiments.localization.people import People
from experiments.localization.sleeves import wrinkled
from saphari_drake.errors import ParameterError
from saphari_drake.math.primitives import CAPSULE, nearest_surface_point, surface_point
from saphari_drake.perception.camera.model import CameraParameters
from saphari_drake.robots.dynamics import DynamicsTerms, evaluate_dynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.sensors.depth_noise import add_kinect_noise
from saphari_drake.simulation.sensors.rgbd_camera import add_depth_camera
from saphari_drake.simulation.sensors.visibility import pixels_near

Array = NDArray[np.float64]
Depth = NDArray[np.float32]

_SKIN = np.array([0.85, 0.65, 0.52, 1.0])
_AWAY = RigidTransform([0.0, 0.0, -50.0])


class DrawnTouch(NamedTuple):
    """The truth of one contact, and how the person's hand lies.

    Attributes
    ----------
    q, v : (n,) arrays
        Posture (rad) and velocity (rad/s) at the first frame.
    link : int
    p_L, n_L : (3,) arrays
        Contact point (m) and outward normal in the link's frame.
    kind : str
        One of `KINDS`.
    hand : int
        Which of the hands.
    X_LH : RigidTransform
        Pose of the hand's frame in the link.
    X_LT : RigidTransform, optional
        Pose of the trunk.
    """

    q: Array
    v: Array
    link: int
    p_L: Array
    n_L: Array
    kind: str
    hand: int
    X_LH: RigidTransform
    X_LT: RigidTransform | None = None


class ContactScenes:
    """A robot, hands of several sizes and some cameras, posed at will.

    Parameters
    ----------
    robot : RobotModel
    cameras : sequence of CameraParameters
    params : SceneParameters
    seed : int
        Seed of the hands' sizes.
    """

    def __init__(
        self, robot: RobotModel, cameras: list[CameraParameters], params: SceneParameters, seed: int = 0
    ) -> None:
        self.robot, self.cameras, self.params = robot, cameras, params
        kind = People if params.people == "measured" else Hands
        self.hands = kind(params, np.random.default_rng([seed, 77]))
        builder = DiagramBuilder()
        self.plant = self.add_plant(builder)
        scene_graph = next(system for system in builder.GetSystems() if isinstance(system, SceneGraph))
        self._arm = self.plant.GetModelInstanceByName(self._arm_name)
        self._bodies = {
            (body, hand): self.plant.GetBodyByName(f"{body}_{hand}")
            for hand in range(params.hands)
            for body in self.hands.bodies
        }
        for k, camera in enumerate(cameras):
            system = add_depth_camera(builder, scene_graph, camera, f"camera_{k}")
            builder.ExportOutput(system.GetOutputPort("depth_image_32f"), f"depth_image_{k}")
        self.diagram: Diagram = builder.Build()
        self._context = self.diagram.CreateDefaultContext()
        self._plant_context = self.plant.GetMyMutableContextFromRoot(self._context)
        self._room = [room_depth(camera) for camera in cameras]
        self._place({})

    def add_plant(self, builder: DiagramBuilder) -> MultibodyPlant:
        """Add a plant with the robot and all hands, finalized, and its scene graph to a builder."""
        plant, _ = AddMultibodyPlantSceneGraph(builder, 0.0)
        self._arm_name = plant.GetModelInstanceName(self.robot.add_to(plant))
        for hand in range(self.params.hands):
            for body in self.hands.bodies:
                self._add_body(plant, body, hand)
        plant.Finalize()
        return plant

    def _add_body(self, plant: MultibodyPlant, kind: str, hand: int) -> None:
        """Add a free body of a person."""
        name = f"{kind}_{hand}"
        body = plant.AddRigidBody(name, plant.AddModelInstance(name), SpatialInertia.SolidSphereWithMass(1.0, 0.05))
        for shape, X, part in self.hands.parts(kind, hand):
            plant.RegisterVisualGeometry(body, X, shape, f"{name}_{part}", _SKIN)

    def _place(self, hands: dict) -> None:
        for key, body in self._bodies.items():
            self.plant.SetFreeBodyPose(self._plant_context, body, hands.get(key, _AWAY))

    # ---- drawing ------------------------------------------------------------------------------------------------

    def poses(self, q: Array) -> DynamicsTerms:
        """Return the robot's kinematics at a posture."""
        return evaluate_dynamics(self.robot, q, np.zeros(self.robot.n))

    def draw(self, rng: np.random.Generator, link: int, kind: str, q: Array | None = None,
             other: DrawnTouch | None = None) -> DrawnTouch:  # fmt: skip
        """Draw a contact on a link that hands and robot can take without touching elsewhere.

        Parameters
        ----------
        q : (n,) array, optional
            Posture; default: random.
        other : DrawnTouch, optional
            Contact of the other hand at that posture, from which this one keeps 15 cm away.
        """
        shapes, own = self.robot.shapes, np.flatnonzero(self.robot.shapes.link == link)
        tries = 4000 if q is None else 300
        for k in range(tries):
            posture = self.posture(rng) if q is None else q
            terms = self.poses(posture)
            R_WS, p_WS = shapes.in_world(terms.R_WL, terms.p_WL)
            s = rng.choice(own)
            around = rng.normal(size=3)
            around *= 0.3 / np.linalg.norm(around)
            around[2] += rng.uniform(-1.0, 1.0) * (shapes.size[s, 1] if shapes.kind[s] == CAPSULE else 0.0)
            _, p, n = surface_point(shapes.kind[s], shapes.size[s], R_WS[s], p_WS[s], p_WS[s] + R_WS[s] @ around)
            others = shapes.link != link
            if nearest_surface_point(shapes.kind, shapes.size, R_WS, p_WS, others, p)[1] < self.params.margin:
                continue
            hand = int(rng.integers(self.params.hands))
            X_WH = self.hands.pose(rng, kind, hand, p, n)
            if p[2] < 0.05 or not self._clear(self.hands.body(kind), hand, X_WH, p, R_WS, p_WS):
                continue
            X_WT = self.hands.trunk(kind, hand, X_WH, p)
            if X_WT is not None and not self._clear("trunk", hand, X_WT, p, R_WS, p_WS, np.inf):
                X_WT = None  # where there is no room, in the end it is left out
                if k < tries // 4:
                    continue
            if other is not None:
                p_other = terms.p_WL[other.link] + terms.R_WL[other.link] @ other.p_L
                if np.linalg.norm(p_other - p) < 0.15:
                    continue
            R_WL, p_WL = terms.R_WL[link], terms.p_WL[link]
            X_LW = RigidTransform(RotationMatrix(R_WL), p_WL).inverse()
            v = rng.uniform(-1.0, 1.0, self.robot.n) * self.params.speed
            return DrawnTouch(posture, v, link, R_WL.T @ (p - p_WL), R_WL.T @ n, kind, hand, X_LW @ X_WH,
                              None if X_WT is None else X_LW @ X_WT)  # fmt: skip
        raise ParameterError("posture", f"no contact of a {kind} on {self.robot.link_names[link]} could be drawn")

    def posture(self, rng: np.random.Generator) -> Array:
        """Return a random posture about home (n,)."""
        reach = np.full(self.robot.n, self.params.posture)
        reach[0] *= 2.0
        q = self.robot.home + rng.uniform(-1.0, 1.0, self.robot.n) * reach
        return np.clip(q, self.robot.q_min, self.robot.q_max)

    def _clear(self, body: str, hand: int, X_WH: RigidTransform, p: Array, R_WS: Array, p_WS: Array,
               below: float = 0.0) -> bool:  # fmt: skip
        """Whether a body touches the robot at p only, and nothing more than `below` (m) under the floor."""
        shapes, everything = self.robot.shapes, np.ones(self.robot.shapes.count, dtype=bool)
        for shape, X, _ in self.hands.parts(body, hand):
            radius = shape.radius()
            half = shape.length() / 2 if isinstance(shape, Capsule) else 0.0
            for t in np.linspace(-half, half, 1 if half == 0.0 else 12):
                centre = X_WH @ X @ np.array([0.0, 0.0, t])
                if centre[2] < radius - below:
                    return False
                gap = nearest_surface_point(shapes.kind, shapes.size, R_WS, p_WS, everything, centre)[1] - radius
                allowed = -1e-6 if np.linalg.norm(centre - p) < radius + 0.03 else 0.005
                if gap < allowed:
                    return False
        return True

    # ---- what sensors show --------------------------------------------------------------------------------------

    def pose(self, touches: list[DrawnTouch], q: Array) -> None:
        """Put the robot at q and the hands where they touch it, all others away."""
        terms = self.poses(q)
        placed = {}
        for touch in touches:
            X_WL = RigidTransform(RotationMatrix(terms.R_WL[touch.link]), terms.p_WL[touch.link])
            placed[self.hands.body(touch.kind), touch.hand] = X_WL @ touch.X_LH
            if touch.X_LT is not None:
                placed["trunk", touch.hand] = X_WL @ touch.X_LT
        self._place(placed)
        self.plant.SetPositions(self._plant_context, self._arm, q)

    def positions(self, touches: list[DrawnTouch], q: Array) -> Array:
        """Return all positions of the plant with the robot at q and the hands where they touch it."""
        self.pose(touches, q)
        return self.plant.GetPositions(self._plant_context)

    def images(self, touches: list[DrawnTouch], q: Array) -> list[Depth]:
        """Return the exact depth image of each camera with the robot at q and the hands where they touch it."""
        self.pose(touches, q)
        return [
            np.minimum(self.diagram.get_output_port(k).Eval(self._context).data[..., 0], room)
            for k, room in enumerate(self._room)
        ]

    def background(self, camera: int, rng: np.random.Generator, frames: int = 5) -> list[Depth]:
        """Return noisy images of a camera with robot and person out of view."""
        return [self.noisy(self._room[camera], camera, rng) for _ in range(frames)]

    def noisy(self, image: Depth, camera: int, rng: np.random.Generator, touches: Sequence[DrawnTouch] = ()) -> Depth:
        """Return an image as a Kinect would measure it, with the sleeves of those who touch at the last postures."""
        p = self.params
        for touch in touches if p.sleeve_sigma > 0.0 else ():
            body = self.plant.GetBodyByName(f"{self.hands.body(touch.kind)}_{touch.hand}")
            X_WH = body.EvalPoseInWorld(self._plant_context)
            parts = self.hands.sleeves(touch.kind, touch.hand)
            image = wrinkled(image, self.cameras[camera], X_WH, parts, rng, p.sleeve_sigma, p.sleeve_length)
        return add_kinect_noise(image, rng, self.params.noise, self.cameras[camera])

    def contact(self, touch: DrawnTouch) -> Array:
        """Return the contact point at the first frame, in the world (3,), m."""
        terms = self.poses(touch.q)
        return terms.p_WL[touch.link] + terms.R_WL[touch.link] @ touch.p_L

    def visible(self, image: Depth, camera: int, touch: DrawnTouch) -> bool:
        """Whether the camera sees enough of the person beside the contact, in an exact image."""
        terms, p = self.poses(touch.q), self.params
        pixels = pixels_near(image, self.cameras[camera], self.robot, terms, self.contact(touch), p.visible_radius)
        return pixels >= p.visible_pixels
