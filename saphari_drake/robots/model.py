"""RobotModel: kinematic tree, inertias, limits and shapes of one arm, read from its URDF or SDF by Drake."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.geometry import SceneGraph
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex

from saphari_drake.errors import ModelError, StateError, UnknownNameError
from saphari_drake.math.tree import tree_kinematics
from saphari_drake.robots.kinematics import Kinematics
from saphari_drake.robots.model_file import packages_above, require_physical_inertias, urdf_effort_limits
from saphari_drake.robots.shapes import LinkShapes, read_shapes
from saphari_drake.robots.tree_reader import read_tree

Array = NDArray[np.float64]


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
        Folders to search for ``package://`` addresses, beside those above the file.

    Attributes
    ----------
    n : int
        Number of joints.
    joint_names, link_names : tuple of str
    q_min, q_max, v_max, tau_max : (n,) arrays
        Limits (infinite where the file gives no position or velocity limit).
    file_tree : Tree
        Tree with the inertias of the file, also where `corrected` has others.

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
        self.tree, self.joint_names, self.link_names, self._frames = read_tree(plant, instance, self.path)
        self.n, self.file_tree = len(self.joint_names), self.tree
        self._read_limits(plant, instance)
        self.home = self._checked_home(plant, home)
        self._shapes: LinkShapes | None = None

    # ---- construction -------------------------------------------------------------------------------------------

    def add_to(self, plant: MultibodyPlant) -> ModelInstanceIndex:
        """Add this robot, welded at X_WB, to a plant that is not finalized; return its model instance."""
        parser = Parser(plant)
        for folder in self._package_dirs:
            parser.package_map().PopulateFromFolder(str(folder))
        for name, place in packages_above(self.path).items():
            if not parser.package_map().Contains(name):
                parser.package_map().Add(name, str(place))
        try:
            instances = parser.AddModels(str(self.path))
        except RuntimeError as error:
            raise ModelError(f"{self.path}: {error}") from error
        require_physical_inertias(self.path)
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
        in_file = urdf_effort_limits(self.path)
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

    def with_home(self, home: ArrayLike) -> RobotModel:
        """Return the same robot with another home posture (n,) (rad or m)."""
        other = copy(self)
        other.home = self.checked_vector(home, "home")
        return other

    def __repr__(self) -> str:
        """Return name, file, and each joint with its limits of position, speed and torque."""
        limits = zip(self.joint_names, self.q_min, self.q_max, self.v_max, self.tau_max)
        rows = [f"  {name}: {a:.3g} … {b:.3g}, speed {v:.3g}, torque {tau:.4g}" for name, a, b, v, tau in limits]
        return "\n".join([f"RobotModel '{self.name}', {self.n} joints, {self.path.name}; rad or m:", *rows])

    # ---- questions ----------------------------------------------------------------------------------------------

    def checked_vector(self, value: ArrayLike, what: str) -> Array:
        """Return `value` as a new (n,) array; raise `StateError` if it has another size or is not finite."""
        array = np.array(value, dtype=float)
        if array.shape != (self.n,):
            raise StateError(f"{what}: {self.name} has {self.n} joints, got shape {array.shape}")
        if not np.all(np.isfinite(array)):
            raise StateError(f"{what}: not finite: {array.tolist()}")
        return array

    def kinematics(self, q: ArrayLike, v: ArrayLike | None = None) -> Kinematics:
        """Return poses, joint axes and, given velocities, the motion of all links; NaN where the state is not finite.

        Parameters
        ----------
        q : (n,) array
            Joint positions (rad or m).
        v : (n,) array, optional
            Joint velocities (rad/s or m/s); default: at rest.

        Raises
        ------
        StateError
            If one has the wrong size.
        """
        q, v = np.array(q, dtype=float), np.zeros(self.n) if v is None else np.array(v, dtype=float)
        if q.shape != (self.n,) or v.shape != (self.n,):
            raise StateError(f"state: {self.name} has {self.n} joints, got shapes {q.shape} and {v.shape}")
        return Kinematics(*tree_kinematics(self.tree, q, v))

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
