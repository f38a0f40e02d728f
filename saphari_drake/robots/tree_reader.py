"""Reads the kinematic tree and the inertias of a model that Drake has parsed."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import FrameIndex, JointIndex, ModelInstanceIndex, PrismaticJoint, RevoluteJoint, WeldJoint
from pydrake.systems.framework import Context

from saphari_drake.errors import ModelError
from saphari_drake.math.tree import PRISMATIC, REVOLUTE, Tree, tree_dynamics, tree_kinematics

Array = NDArray[np.float64]


class TreeModel(NamedTuple):
    """A tree with its names and frames."""

    tree: Tree
    joint_names: tuple[str, ...]
    link_names: tuple[str, ...]
    frames: dict[str, tuple[int, RigidTransform]]  # link that a frame is fixed in (−1: the world), and its pose there


def read_tree(plant: MultibodyPlant, instance: ModelInstanceIndex, path: Path) -> TreeModel:
    """Read a model instance of a finalized plant; `path` is named in errors.

    Raises
    ------
    ModelError
        If a joint is neither revolute nor prismatic, there is none, or one moves no inertia.
    """
    context = plant.CreateDefaultContext()
    joints = _joints_in_order(plant, instance, path)
    if not joints:
        raise ModelError(f"{path}: has no revolute or prismatic joint")
    n, links = len(joints), [joint.child_body() for joint in joints]
    link_of = {body.index(): j for j, body in enumerate(links)}
    for root in [plant.world_body(), *links]:
        for welded in plant.GetBodiesWeldedTo(root):
            link_of.setdefault(welded.index(), link_of.get(root.index(), -1))
    parent = np.array([link_of[joint.parent_body().index()] for joint in joints], dtype=np.int64)
    mass, com, inertia = np.zeros(n), np.zeros((n, 3)), np.zeros((n, 3, 3))
    R_PF, p_PF, R_ML, p_ML = np.empty((n, 3, 3)), np.empty((n, 3)), np.empty((n, 3, 3)), np.empty((n, 3))
    for j, joint in enumerate(joints):
        mass[j], com[j], inertia[j] = _lumped_inertia(plant, context, links[j])
        parent_frame = links[parent[j]].body_frame() if parent[j] >= 0 else plant.world_frame()
        X_PF = joint.frame_on_parent().CalcPose(context, parent_frame)
        X_ML = links[j].body_frame().CalcPose(context, joint.frame_on_child())
        R_PF[j], p_PF[j] = X_PF.rotation().matrix(), X_PF.translation()
        R_ML[j], p_ML[j] = X_ML.rotation().matrix(), X_ML.translation()
    tree = Tree(
        parent,
        np.array([REVOLUTE if isinstance(joint, RevoluteJoint) else PRISMATIC for joint in joints]),
        np.array([_axis(joint) for joint in joints]),
        R_PF,
        p_PF,
        R_ML,
        p_ML,
        mass,
        com,
        inertia,
        np.array([_reflected_inertia(plant, joint) for joint in joints]),
        np.array(plant.gravity_field().gravity_vector(), dtype=float),
    )
    link_names = tuple(body.name() for body in links)
    _require_inertia(tree, np.array(plant.GetPositions(context)), link_names, path)
    frames: dict[str, tuple[int, RigidTransform]] = {}
    others = map(FrameIndex, range(1, plant.num_frames()))
    for index in [*plant.GetFrameIndices(instance), *others]:  # those of tools are of other models
        frame = plant.get_frame(index)
        if frame.name() in frames or frame.body().index() not in link_of:
            continue
        link = link_of[frame.body().index()]
        base = links[link].body_frame() if link >= 0 else plant.world_frame()
        frames[frame.name()] = (link, frame.CalcPose(context, base))
    return TreeModel(tree, tuple(joint.name() for joint in joints), link_names, frames)


def _require_inertia(t: Tree, q: Array, link_names: tuple[str, ...], path: Path) -> None:
    """Every joint must move some inertia, on its own link or farther out, or M has no inverse."""
    v = np.zeros_like(q)
    M = tree_dynamics(t, tree_kinematics(t, q, v), v)[0]
    lacking = [name for j, name in enumerate(link_names) if M[j, j] < 1e-12]
    if lacking:
        raise ModelError(f"{path}: no mass or inertia (inertial element) on moving link {', '.join(lacking)}")


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


def _lumped_inertia(plant: MultibodyPlant, context: Context, link) -> tuple[float, Array, Array]:
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
