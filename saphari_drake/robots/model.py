"""RobotModel: kinematic tree, inertias, limits and shapes of one arm, read from its URDF, SDF or MJCF by Drake."""

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
from saphari_drake.robots.assembly import (
    Values,
    add_actuators,
    add_packages,
    chosen_joints,
    held_position,
    joints_of,
    limits_by_joint,
    lock,
    parsed,
    require_tree,
    resting_position,
    weld_root,
)
from saphari_drake.robots.attached import Payload, Tool, attach
from saphari_drake.robots.kinematics import Kinematics
from saphari_drake.robots.model_file import read_facts
from saphari_drake.robots.shapes import LinkShapes, read_shapes
from saphari_drake.robots.tree_reader import read_tree

Array = NDArray[np.float64]


class RobotModel:
    """An arm with n revolute or prismatic joints, on a fixed or a mobile base.

    Link j is the body that joint j moves; bodies welded to it are part of it. A mobile base is a chain of joints
    (prismatic x and y, revolute z) below the arm. Everything is read from the model file; what the file lacks is
    named in a `ModelError` or given by an argument. Whatever plant it is added to is as the arguments say.

    Parameters
    ----------
    path : path
        URDF, SDF or MJCF with exactly one model.
    X_WB : RigidTransform, optional
        Pose in the world of the model's root body, which is welded there; for files that do not weld it themselves.
    home : (n,) array or mapping from joint name, optional
        Home posture (rad or m); default: the file's default positions, and the middle of the limits of a joint for
        which that lies outside. A mapping may also tell where joints that do not move stay.
    effort_limits, velocity_limits : (n,) array or mapping from joint name, optional
        Limits of torque or force (Nm or N) and of speed (rad/s or m/s); they replace those of the file.
    joints : sequence of str, optional
        Joints that move, ``*`` for any letters; the others are welded where they are. Default: all but those that
        follow others (mimic) and those that are followed, as the fingers of a gripper.
    attached : sequence of Payload and Tool, optional
        What the arm carries, part of its links from then on.
    package_dirs : sequence of paths, optional
        Folders to search for ``package://`` addresses, before Drake's own packages.

    Attributes
    ----------
    n : int
        Number of joints.
    joint_names, link_names : tuple of str
    q_min, q_max, v_max, tau_max : (n,) arrays
        Limits (infinite where the file gives no position or velocity limit).
    viscous, coulomb : (n,) arrays
        Friction of the joints as the file has it (Nms/rad or Ns/m, and Nm or N). Drake's plant has the viscous one
        alone, and so has what `MomentumObserver` expects, unless it is told another.
    file_tree : Tree
        Tree with the inertias of the file, also where `corrected` has others.

    Raises
    ------
    ModelError
        If the file does not exist, does not parse, has other joints or a loop of them, lacks mass or effort limits, or
        fixes its root to the world itself and X_WB is given.
    StateError
        If `home` has another size, or lies outside the limits.
    """

    def __init__(
        self,
        path: str | Path,
        *,
        X_WB: RigidTransform | None = None,
        home: Values | None = None,
        effort_limits: Values | None = None,
        velocity_limits: Values | None = None,
        joints: Sequence[str] = (),
        attached: Sequence[Payload | Tool] = (),
        package_dirs: Sequence[str | Path] = (),
    ) -> None:
        self.path = Path(path)
        self.X_WB = X_WB or RigidTransform()
        self._package_dirs, self._attached, self._joints = tuple(package_dirs), tuple(attached), tuple(joints)
        self._effort_limits, self._positions = effort_limits, home if isinstance(home, Mapping) else {}
        if not self.path.is_file():
            raise ModelError(f"no model file '{self.path}'")
        self._facts = read_facts(self.path)
        plant = MultibodyPlant(0.0)
        instance = self.add_to(plant)
        plant.Finalize()
        self.name = plant.GetModelInstanceName(instance)
        self.tree, self.joint_names, self.link_names, self._frames = read_tree(plant, instance, self.path)
        self.n, self.file_tree = len(self.joint_names), self.tree
        self._read_joints(plant, instance, velocity_limits)
        if home is not None and not isinstance(home, Mapping):
            self.home = self.checked_posture(home, "home")
        self._shapes: LinkShapes | None = None

    # ---- construction -------------------------------------------------------------------------------------------

    def add_to(self, plant: MultibodyPlant) -> ModelInstanceIndex:
        """Add this robot, welded at X_WB, to a plant that is not finalized; return its model instance.

        A second robot of the same name gets another name.
        """
        parser = Parser(plant)
        parser.SetAutoRenaming(True)
        add_packages(parser, self.path, self._package_dirs)
        instance = parsed(plant, parser, self.path, len(self._facts.mimic))
        weld_root(plant, instance, self.X_WB, self.path)
        require_tree(plant, instance, self.path)
        joints = {joint.name(): joint for joint in joints_of(plant, instance)}
        for name in self._positions:
            if name not in joints:
                raise UnknownNameError("joint", name, joints)
        moving = chosen_joints(list(joints), self._joints, self._facts.mimic, self.path)
        held = {name: held_position(name, joints, self._positions, self._facts.mimic) for name in joints}
        for name in sorted(held.keys() - set(moving)):
            lock(plant, joints[name], held[name])
        limits = limits_by_joint(self._effort_limits, moving, "effort_limits")
        add_actuators(plant, instance, limits, self._facts.effort, self.path)
        if moving:
            attach(plant, parser, self._attached, joints[moving[-1]].child_body())
        return instance

    def _read_joints(self, plant: MultibodyPlant, instance: ModelInstanceIndex, speeds: Values | None) -> None:
        joints = [plant.GetJointByName(name, instance) for name in self.joint_names]
        self.q_min = np.array([joint.position_lower_limits()[0] for joint in joints])
        self.q_max = np.array([joint.position_upper_limits()[0] for joint in joints])
        given = limits_by_joint(speeds, self.joint_names, "velocity_limits")
        own = zip(self.joint_names, joints)
        self.v_max = np.array([given.get(name, joint.velocity_upper_limits()[0]) for name, joint in own])
        self.viscous = np.array([joint.default_damping_vector()[0] for joint in joints])
        self.coulomb = np.array([self._facts.coulomb.get(name, 0.0) for name in self.joint_names])
        actuators = [plant.get_joint_actuator(i) for i in plant.GetJointActuatorIndices(instance)]
        limit = {actuator.joint().name(): actuator.effort_limit() for actuator in actuators}
        self.tau_max = np.array([limit[name] for name in self.joint_names])
        self.actuator_order = np.array([self.joint_names.index(a.joint().name()) for a in actuators])

        rest = [self._positions.get(name, resting_position(joint)) for name, joint in zip(self.joint_names, joints)]
        self.home = self.checked_posture(rest, "home")

    def with_home(self, home: ArrayLike) -> RobotModel:
        """Return the same robot with another home posture (n,) (rad or m); `StateError` if it is outside the limits."""
        other = copy(self)
        other.home = self.checked_posture(home, "home")
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

    def checked_posture(self, q: ArrayLike, what: str) -> Array:
        """Return `q` as a new (n,) array; `StateError` if it has another size, or a joint is outside its limits."""
        array = self.checked_vector(q, what)
        for name, value, low, high in zip(self.joint_names, array, self.q_min, self.q_max):
            if not low - 1e-6 <= value <= high + 1e-6:
                raise StateError(f"{what}: {value:.4g} of {name} is outside its limits {low:.4g} … {high:.4g}")
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
            self._shapes = read_shapes(plant, scene_graph.model_inspector(), instance, self.link_names)
            if self._shapes.count == 0:
                raise ModelError(f"{self.path}: no collision geometry on any link")
        return self._shapes
