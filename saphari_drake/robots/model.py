"""RobotModel: kinematic tree, inertias, limits and shapes of one arm, read from its URDF or SDF by Drake."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.geometry import SceneGraph
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JointIndex, ModelInstanceIndex, PrismaticJoint, RevoluteJoint, WeldJoint

from saphari_drake.errors import ModelError, StateError, UnknownNameError
from saphari_drake.math.tree import PRISMATIC, REVOLUTE, tree_dynamics, tree_kinematics
from saphari_drake.robots.shapes import LinkShapes, read_shapes

Array = NDArray[np.float64]


class Tree(NamedTuple):
    """Constants of a tree of one-degree-of-freedom joints, as `saphari_drake.math.tree` takes them."""

    parent: NDArray[np.int64]
    kind: NDArray[np.int64]
    axis: Array
    R_PF: Array
    p_PF: Array
    R_ML: Array
    p_ML: Array
    mass: Array
    com: Array
    inertia: Array
    armature: Array
    gravity: Array


class RobotModel:
    """An arm with n revolute or prismatic joints, on a fixed or a mobile base.

    Link j is the body that joint j moves; bodies welded to it are part of it. A mobile base is a chain of joints
    (prismatic x and y, revolute z) below the arm. Everything is read from the model file; what the file lacks is
    named in a `ModelError` or given by an argument.

    Parameters
    ----------
    path : path
        URDF or SDF with exactly one model.
    X_WB : RigidTransform, optional
        Pose in the world of the model's root body, which is welded there; for files that do not weld it themselves.
    home : (n,) array, optional
        Home posture (rad or m); default: the file's default positions.
    effort_limits : (n,) array or mapping from joint name, optional
        Joint torque (or force) limits; replaces those of the file.
    package_dirs : sequence of paths, optional
        Folders to search for ``package://`` addresses.

    Attributes
    ----------
    n : int
        Number of joints.
    joint_names, link_names : tuple of str
    q_min, q_max, v_max, tau_max : (n,) arrays
        Limits (infinite where the file gives no position or velocity limit).

    Raises
    ------
    ModelError
        If the file does not exist, does not parse, has other joints, lacks mass or effort limits, or fixes its root to
        the world itself and X_WB is given.
    """

    def __init__(
        self,
        path: str | Path,
        *,
        X_WB: RigidTransform | None = None,
        home: ArrayLike | None = None,
        effort_limits: ArrayLike | Mapping[str, float] | None = None,
        package_dirs: Sequence[str | Path] = (),
    ) -> None:
        self.path = Path(path)
        self.X_WB = X_WB or RigidTransform()
        self._package_dirs = tuple(package_dirs)
        self._effort_limits = effort_limits
        if not self.path.is_file():
            raise ModelError(f"no model file '{self.path}'")
        plant = MultibodyPlant(0.0)
        instance = self.add_to(plant)
        plant.Finalize()
        self.name = plant.GetModelInstanceName(instance)
        self._read_tree(plant, instance)
        self._read_limits(plant, instance)
        self.home = self._checked_home(plant, home)
        self._shapes: LinkShapes | None = None

    # ---- construction -------------------------------------------------------------------------------------------

    def add_to(self, plant: MultibodyPlant) -> ModelInstanceIndex:
        """Add this robot, welded at X_WB, to a plant that is not finalized; return its model instance."""
        parser = Parser(plant)
        for folder in self._package_dirs:
            parser.package_map().PopulateFromFolder(str(folder))
        try:
            instances = parser.AddModels(str(self.path))
        except RuntimeError as error:
            raise ModelError(f"{self.path}: {error}") from error
        if len(instances) != 1:
            raise ModelError(f"{self.path}: holds {len(instances)} models; one is needed")
        (instance,) = instances
        self._weld_root(plant, instance)
        self._add_actuators(plant, instance)
        return instance

    def _weld_root(self, plant: MultibodyPlant, instance: ModelInstanceIndex) -> None:
        joints = [plant.get_joint(index) for index in plant.GetJointIndices(instance)]
        children = {joint.child_body().index() for joint in joints}
        bodies = [plant.get_body(index) for index in plant.GetBodyIndices(instance)]
        roots = [body for body in bodies if body.index() not in children]
        if len(roots) > 1:
            names = ", ".join(body.name() for body in roots)
            raise ModelError(f"{self.path}: more than one body without a parent joint, or with a floating one: {names}")
        if roots:
            plant.WeldFrames(plant.world_frame(), roots[0].body_frame(), self.X_WB)
        elif not self.X_WB.IsExactlyIdentity():
            raise ModelError(f"{self.path}: the file fixes its root to the world; leave X_WB out")

    def _add_actuators(self, plant: MultibodyPlant, instance: ModelInstanceIndex) -> None:
        """Give every joint an actuator, in the order of the joints, with a finite effort limit."""
        actuated = {}
        for index in plant.GetJointActuatorIndices():  # by instance, the list is empty before Finalize
            actuator = plant.get_joint_actuator(index)
            if actuator.model_instance() == instance:
                actuated[actuator.joint().name()] = actuator
        joints = [plant.get_joint(i) for i in plant.GetJointIndices(instance)]
        moving = [joint for joint in joints if joint.num_velocities() == 1]
        limits = self._given_effort_limits([joint.name() for joint in moving])
        in_file = _urdf_efforts(self.path)
        missing = []
        for joint in moving:
            name = joint.name()
            limit = limits.get(name, actuated[name].effort_limit() if name in actuated else in_file.get(name, np.inf))
            if not (np.isfinite(limit) and limit > 0.0):
                missing.append(name)
            elif name in actuated:
                actuated[name].set_effort_limit(limit)
            else:
                plant.AddJointActuator(name, joint, limit)
        if missing:
            raise ModelError(f"{self.path}: no finite effort limit > 0 for {', '.join(missing)}; pass effort_limits")

    def _given_effort_limits(self, joints: list[str]) -> dict[str, float]:
        given = self._effort_limits
        if given is None:
            return {}
        if isinstance(given, Mapping):
            for name in given:
                if name not in joints:
                    raise UnknownNameError("joint", name, joints)
            return dict(given)
        values = np.asarray(given, dtype=float)
        if values.shape != (len(joints),):
            raise ModelError(f"effort_limits: needs {len(joints)} entries ({', '.join(joints)}), got {values.shape}")
        return dict(zip(joints, values.tolist()))

    def _read_tree(self, plant: MultibodyPlant, instance: ModelInstanceIndex) -> None:
        context = plant.CreateDefaultContext()
        joints = _joints_in_order(plant, instance, self.path)
        if not joints:
            raise ModelError(f"{self.path}: has no revolute or prismatic joint")
        self.n = len(joints)
        self.joint_names = tuple(joint.name() for joint in joints)
        link_bodies = [joint.child_body() for joint in joints]
        self.link_names = tuple(body.name() for body in link_bodies)
        link_of = {body.index(): j for j, body in enumerate(link_bodies)}
        self._frames: dict[str, tuple[int, RigidTransform]] = {}
        mass, com, inertia = np.zeros(self.n), np.zeros((self.n, 3)), np.zeros((self.n, 3, 3))
        for root in [None, *link_bodies]:
            body = plant.world_body() if root is None else root
            for welded in plant.GetBodiesWeldedTo(body):
                link_of.setdefault(welded.index(), -1 if root is None else link_of[body.index()])
        for j, body in enumerate(link_bodies):
            mass[j], com[j], inertia[j] = _lumped_inertia(plant, context, body)
        parent = np.array([link_of[joint.parent_body().index()] for joint in joints], dtype=np.int64)
        R_PF, p_PF = np.empty((self.n, 3, 3)), np.empty((self.n, 3))
        R_ML, p_ML = np.empty((self.n, 3, 3)), np.empty((self.n, 3))
        for j, joint in enumerate(joints):
            parent_frame = link_bodies[parent[j]].body_frame() if parent[j] >= 0 else plant.world_frame()
            X_PF = joint.frame_on_parent().CalcPose(context, parent_frame)
            X_ML = link_bodies[j].body_frame().CalcPose(context, joint.frame_on_child())
            R_PF[j], p_PF[j] = X_PF.rotation().matrix(), X_PF.translation()
            R_ML[j], p_ML[j] = X_ML.rotation().matrix(), X_ML.translation()
        axis = np.array([_axis(joint) for joint in joints])
        kind = np.array([REVOLUTE if isinstance(joint, RevoluteJoint) else PRISMATIC for joint in joints])
        armature = np.array([_reflected_inertia(plant, joint) for joint in joints])
        gravity = plant.gravity_field().gravity_vector()
        self.tree = Tree(
            parent, kind, axis, R_PF, p_PF, R_ML, p_ML, mass, com, inertia, armature, np.array(gravity, dtype=float)
        )
        self._require_inertia(np.array(plant.GetPositions(context)))
        for index in plant.GetFrameIndices(instance):
            frame = plant.get_frame(index)
            link = link_of[frame.body().index()]
            base = link_bodies[link].body_frame() if link >= 0 else plant.world_frame()
            self._frames[frame.name()] = (link, frame.CalcPose(context, base))

    def _require_inertia(self, q: Array) -> None:
        """Every joint must move some inertia, on its own link or farther out, or M has no inverse."""
        t, v = self.tree, np.zeros(self.n)
        kinematics = tree_kinematics(t.parent, t.kind, t.axis, t.R_PF, t.p_PF, t.R_ML, t.p_ML, q, v)
        M = tree_dynamics(t.parent, t.mass, t.com, t.inertia, t.armature, t.gravity, *kinematics, v)[0]
        lacking = [self.link_names[j] for j in range(self.n) if M[j, j] < 1e-12]
        if lacking:
            raise ModelError(f"{self.path}: no mass or inertia (inertial element) on moving link {', '.join(lacking)}")

    def _read_limits(self, plant: MultibodyPlant, instance: ModelInstanceIndex) -> None:
        joints = [plant.GetJointByName(name, instance) for name in self.joint_names]
        self.q_min = np.array([joint.position_lower_limits()[0] for joint in joints])
        self.q_max = np.array([joint.position_upper_limits()[0] for joint in joints])
        self.v_max = np.array([joint.velocity_upper_limits()[0] for joint in joints])
        actuators = [plant.get_joint_actuator(i) for i in plant.GetJointActuatorIndices(instance)]
        limit = {actuator.joint().name(): actuator.effort_limit() for actuator in actuators}
        self.tau_max = np.array([limit[name] for name in self.joint_names])
        self.actuator_order = np.array([self.joint_names.index(a.joint().name()) for a in actuators])

    def _checked_home(self, plant: MultibodyPlant, home: ArrayLike | None) -> Array:
        if home is None:
            return np.array(plant.GetPositions(plant.CreateDefaultContext()))
        return self.checked_vector(home, "home")

    # ---- questions ----------------------------------------------------------------------------------------------

    def checked_vector(self, value: ArrayLike, what: str) -> Array:
        """Return `value` as a new (n,) array; raise `StateError` if it has another size or is not finite."""
        array = np.array(value, dtype=float)
        if array.shape != (self.n,):
            raise StateError(f"{what}: {self.name} has {self.n} joints, got shape {array.shape}")
        if not np.all(np.isfinite(array)):
            raise StateError(f"{what}: not finite: {array.tolist()}")
        return array

    def link_index(self, name: str) -> int:
        """Return the index of a moving link by the name of its body, or of a body welded to it."""
        link, _ = self._frames.get(name, (-1, None))
        if link < 0:
            raise UnknownNameError("link", name, self.link_names)
        return link

    def joint_index(self, name: str) -> int:
        """Return the index of a joint."""
        if name not in self.joint_names:
            raise UnknownNameError("joint", name, self.joint_names)
        return self.joint_names.index(name)

    def frame(self, name: str) -> tuple[int, RigidTransform]:
        """Return the link that a frame is fixed in (−1: the world), and the frame's pose in it."""
        if name not in self._frames:
            raise UnknownNameError("frame", name, self._frames)
        return self._frames[name]

    @property
    def shapes(self) -> LinkShapes:
        """Collision shapes of the links as primitives, read at first use (`ModelError` if there are none)."""
        if self._shapes is None:
            plant, scene_graph = MultibodyPlant(0.0), SceneGraph()
            plant.RegisterAsSourceForSceneGraph(scene_graph)
            instance = self.add_to(plant)
            plant.Finalize()
            context = plant.CreateDefaultContext()
            self._shapes = read_shapes(plant, scene_graph.model_inspector(), context, instance, self.link_names)
            if self._shapes.count == 0:
                raise ModelError(f"{self.path}: no collision geometry on any link")
        return self._shapes


def _joints_in_order(plant: MultibodyPlant, instance: ModelInstanceIndex, path: Path) -> list:
    """Moving joints in the order of the plant's positions, which puts parents first."""
    joints = [plant.get_joint(JointIndex(i)) for i in plant.GetJointIndices(instance)]
    joints = [joint for joint in joints if joint.num_velocities() > 0 or not isinstance(joint, WeldJoint)]
    for joint in joints:
        if not isinstance(joint, (RevoluteJoint, PrismaticJoint)):
            raise ModelError(f"{path}: joint '{joint.name()}' is {joint.type_name()}; only revolute and prismatic work")
    return sorted(joints, key=lambda joint: joint.position_start())


def _axis(joint: RevoluteJoint | PrismaticJoint) -> Array:
    axis = joint.revolute_axis() if isinstance(joint, RevoluteJoint) else joint.translation_axis()
    return np.array(axis, dtype=float)


def _lumped_inertia(plant: MultibodyPlant, context, link) -> tuple[float, Array, Array]:
    """Mass, centre of mass and central inertia of a link with the bodies welded to it, in the link frame."""
    bodies = [body.index() for body in plant.GetBodiesWeldedTo(link)]
    mass = sum(plant.get_body(index).get_mass(context) for index in bodies)
    if mass <= 0.0:
        return 0.0, np.zeros(3), np.zeros((3, 3))
    inertia = plant.CalcSpatialInertia(context, link.body_frame(), bodies)
    about_com = inertia.Shift(inertia.get_com()).CalcRotationalInertia()
    return inertia.get_mass(), np.array(inertia.get_com()), np.array(about_com.CopyToFullMatrix3())


def _reflected_inertia(plant: MultibodyPlant, joint) -> float:
    for index in plant.GetJointActuatorIndices():
        actuator = plant.get_joint_actuator(index)
        if actuator.joint().index() == joint.index():
            return float(actuator.default_rotor_inertia() * actuator.default_gear_ratio() ** 2)
    return 0.0


def _urdf_efforts(path: Path) -> dict[str, float]:
    """Effort limits of a URDF's joints; Drake keeps them only where there is a transmission."""
    if path.suffix.lower() not in (".urdf", ".xml"):
        return {}
    limits = ((joint.get("name", ""), joint.find("limit")) for joint in ElementTree.parse(path).getroot().iter("joint"))
    return {name: float(limit.get("effort", "inf")) for name, limit in limits if limit is not None}
