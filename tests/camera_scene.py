"""The LWR4 touched by a hand, as the depth camera sees it; shared by the tests of perception."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from pydrake.geometry import Capsule, Sphere
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.framework import DiagramBuilder

from saphari_drake.math.primitives import nearest_surface_point, surface_point
from saphari_drake.perception.camera.model import CameraParameters, camera_pose
from saphari_drake.perception.contact.parameters import LocalizerParameters
from saphari_drake.perception.contact.places import Place, PlaceFinder
from saphari_drake.perception.segmentation.robot_filter import RobotFilter
from saphari_drake.robots.catalog import lwr4
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.simulation.sensors.depth_noise import DepthNoiseParameters, add_kinect_noise
from saphari_drake.simulation.sensors.rgbd_camera import add_depth_camera

WHITE = np.ones(4)


class Touch(NamedTuple):
    """A visible touch: posture, link, contact point and normal in the world, direction of the finger away from it."""

    q: np.ndarray
    R_WL: np.ndarray
    p_WL: np.ndarray
    link: int
    p_WC: np.ndarray
    n_W: np.ndarray
    finger: np.ndarray


class HandScene:
    """An LWR4 and a free hand: a finger along z of its frame with the tip at the origin, a fist and a forearm."""

    def __init__(self, radius: float, camera: CameraParameters | None = None) -> None:
        self.radius, self.robot = radius, lwr4()
        self.camera = camera or CameraParameters(renderer="raycast")
        builder = DiagramBuilder()
        self.plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.0)
        self.arm = self.robot.add_to(self.plant)
        inertia = SpatialInertia.SolidSphereWithMass(1.0, 0.05)
        self.hand = self.plant.AddRigidBody("hand", self.plant.AddModelInstance("hand"), inertia)
        for z, shape, name in (
            (radius + 0.04, Capsule(radius, 0.08), "finger"),
            (radius + 0.12, Sphere(0.045), "fist"),
            (radius + 0.29, Capsule(0.035, 0.26), "forearm"),
        ):
            self.plant.RegisterVisualGeometry(self.hand, RigidTransform([0.0, 0.0, z]), shape, name, WHITE)
        self.plant.Finalize()
        system = add_depth_camera(builder, scene_graph, self.camera)
        builder.ExportOutput(system.GetOutputPort("depth_image_32f"))
        self.diagram = builder.Build()
        self.context = self.diagram.CreateDefaultContext()

    def poses(self, q):
        terms = evaluate_dynamics(self.robot, q, np.zeros(self.robot.n))
        return terms.R_WL, terms.p_WL

    def image(self, q, touch: Touch | None = None) -> np.ndarray:
        """Depth image of posture q with the hand at a touch, or without a hand."""
        pose = RigidTransform([0.0, 0.0, -50.0])
        if touch is not None:
            z = touch.finger
            x = np.cross([0.3, 0.5, 0.8], z)
            x /= np.linalg.norm(x)
            rotation = RotationMatrix(np.column_stack([x, np.cross(z, x), z]))
            pose = RigidTransform(rotation, touch.p_WC + self.radius * (touch.n_W - z))
        context = self.plant.GetMyMutableContextFromRoot(self.context)
        self.plant.SetPositions(context, self.arm, q)
        self.plant.SetFreeBodyPose(context, self.hand, pose)
        return self.diagram.get_output_port(0).Eval(self.context).data[..., 0].copy()

    def random_touch(self, rng: np.random.Generator) -> Touch:
        """Draw a touch of links 3–6 (indices 2–5) that the camera sees, with the hand clear of the robot."""
        shapes = self.robot.shapes
        everything = np.ones(shapes.count, dtype=bool)
        eye = camera_pose(self.camera).translation()
        candidates = np.flatnonzero((shapes.link >= 2) & (shapes.link <= 5))
        while True:
            q = self.robot.home + rng.uniform(-0.5, 0.5, self.robot.n)
            R_WL, p_WL = self.poses(q)
            R, p = shapes.in_world(R_WL, p_WL)

            def clearance(points, R=R, p=p):
                return min(nearest_surface_point(shapes.kind, shapes.size, R, p, everything, x)[1] for x in points)

            s = rng.choice(candidates)
            around = p[s] + R[s] @ (rng.uniform(-1.0, 1.0, 3) * [0.2, 0.2, shapes.size[s, 1] + 0.05])
            _, point, normal = surface_point(shapes.kind[s], shapes.size[s], R[s], p[s], around)
            to_eye = eye - point
            view = to_eye / np.linalg.norm(to_eye)
            finger = normal + 0.35 * rng.normal(size=3)
            finger /= np.linalg.norm(finger)
            others = np.flatnonzero(shapes.link != shapes.link[s])
            if (
                normal @ view > 0.35
                and finger @ normal > 0.75
                and finger @ view < 0.9
                and min(surface_point(shapes.kind[i], shapes.size[i], R[i], p[i], point)[0] for i in others) > 0.03
                and clearance(point + to_eye * np.linspace(0.03, 0.9, 40)[:, None]) > 0.0
                and clearance(point + finger * np.linspace(0.1, 0.45, 15)[:, None]) > 0.085
            ):
                return Touch(q, R_WL, p_WL, int(shapes.link[s]), point, normal, finger)


def noisy(image, seed):
    """An image as a Kinect measures it."""
    return add_kinect_noise(image, np.random.default_rng(seed), DepthNoiseParameters())


def place_finder(scene: HandScene, background=None) -> PlaceFinder:
    """What finds places in the images of a scene's camera."""
    params = LocalizerParameters()
    return PlaceFinder(RobotFilter(scene.robot.shapes, scene.camera, params, background), params)


def likeliest(finder: PlaceFinder, image, touch) -> tuple[Place, float]:
    """The likeliest explanation of an image of a touch, and its error (m)."""
    place = min(finder.look(image, touch.R_WL, touch.p_WL).places, key=lambda place: place.cost)
    p_WC = touch.p_WL[place.link] + touch.R_WL[place.link] @ place.p_LC
    return place, float(np.linalg.norm(p_WC - touch.p_WC))
