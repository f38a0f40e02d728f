"""How a model comes into a plant: its packages, the joints that stay, its root, and its actuators."""

from __future__ import annotations

import fnmatch
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.parsing import PackageMap, Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    Joint,
    JointIndex,
    ModelInstanceIndex,
    PrismaticJoint,
    RevoluteJoint,
    RigidBody,
    WeldJoint,
)

from saphari_drake.errors import ModelError, UnknownNameError
from saphari_drake.robots.mesh_files import with_usable_meshes
from saphari_drake.robots.model_file import Mimic

Array = NDArray[np.float64]
Values = ArrayLike | Mapping[str, float]  # one a joint


def add_packages(parser: Parser, path: Path, folders: Sequence[str | Path]) -> None:
    """Tell a parser where packages are: in the folders, also where Drake has one of that name, or above the file.

    Raises
    ------
    ModelError
        If a folder does not exist.
    """
    known, given = parser.package_map(), PackageMap.MakeEmpty()
    for folder in folders:
        if not Path(folder).is_dir():
            raise ModelError(f"{path}: no folder of packages '{folder}'")
        given.PopulateFromFolder(str(Path(folder).resolve()))
    for name in given.GetPackageNames():
        if known.Contains(name):
            known.Remove(name)
        known.Add(name, given.GetPath(name))
    # As ROS has it: package://NAME is a folder NAME, at best with a package.xml in it.
    text = path.read_text(encoding="utf-8", errors="replace")
    for name in sorted(set(re.findall(r"(?:package|model)://([^/\"'<\s]+)/", text))):
        places = [place for above in path.resolve().parents for place in (above, above / name) if place.name == name]
        places += [Path(folder).resolve() / name for folder in folders]
        found = [place for place in places if place.is_dir()]
        if found and not known.Contains(name):
            known.Add(name, str(found[0]))


def parsed(plant: MultibodyPlant, parser: Parser, path: Path, followers: int) -> ModelInstanceIndex:
    """Add the one model of a file to a plant; `followers` is how many of its joints follow others.

    Raises
    ------
    ModelError
        If it does not parse, holds another number of models, or ties links to one another in other ways than by joints.
    """
    before = set(plant.GetConstraintIds())
    shown = plant.geometry_source_is_registered()
    text = with_usable_meshes(path, parser.package_map()) if shown else None
    try:
        if text is None:
            instances = parser.AddModels(str(path))
        else:
            instances = parser.AddModelsFromString(text, path.suffix.lower().lstrip("."))
    except (RuntimeError, SystemExit) as error:  # Drake's own checks leave the process
        raise ModelError(f"{path}: {str(error).replace('<literal-string>', path.stem)}") from error
    if len(instances) != 1:
        raise ModelError(f"{path}: holds {len(instances)} models; one is needed")
    constraints = [index for index in plant.GetConstraintIds() if index not in before]
    if len(constraints) > followers:
        raise ModelError(f"{path}: a constraint ties its links to a kinematic loop; only trees work")
    for index in constraints:  # of joints that follow others; they will not move
        plant.RemoveConstraint(index)
    return instances[0]


def weld_root(plant: MultibodyPlant, instance: ModelInstanceIndex, X_WB: RigidTransform, path: Path) -> None:
    """Weld the root of a model to the world; `ModelError` if there are several, or the file does and X_WB is given."""
    roots = root_bodies(plant, instance)
    if len(roots) > 1:
        names = ", ".join(body.name() for body in roots)
        raise ModelError(f"{path}: more than one body without a parent joint, or with a floating one: {names}")
    if roots:
        plant.WeldFrames(plant.world_frame(), roots[0].body_frame(), X_WB)
    elif not X_WB.IsExactlyIdentity():
        raise ModelError(f"{path}: the file fixes its root to the world; leave X_WB out")


def joints_of(plant: MultibodyPlant, instance: ModelInstanceIndex) -> list[Joint]:
    """Return the joints of a model that move, of one degree of freedom each."""
    joints = [plant.get_joint(JointIndex(index)) for index in plant.GetJointIndices(instance)]
    return [joint for joint in joints if joint.num_velocities() == 1]


def root_bodies(plant: MultibodyPlant, instance: ModelInstanceIndex) -> list[RigidBody]:
    """Return the bodies of a model that no joint moves or fixes."""
    joints = [plant.get_joint(index) for index in plant.GetJointIndices(instance)]
    children = {joint.child_body().index() for joint in joints}
    bodies = [plant.get_body(index) for index in plant.GetBodyIndices(instance)]
    return [body for body in bodies if body.index() not in children]


def require_tree(plant: MultibodyPlant, instance: ModelInstanceIndex, path: Path) -> None:
    """Demand that joints form no loop; `ModelError` names a joint that closes one."""
    above: dict[int, int] = {}
    for joint in (plant.get_joint(index) for index in plant.GetJointIndices(instance)):
        parent, child = int(joint.parent_body().index()), int(joint.child_body().index())
        place: int | None = parent
        while place is not None and place != child:
            place = above.get(place)
        if child in above or place == child:
            name = f"joint '{joint.name()}' to link '{joint.child_body().name()}'"
            raise ModelError(f"{path}: {name} closes a kinematic loop; leave that joint out")
        above[child] = parent


def chosen_joints(joints: Sequence[str], given: Sequence[str], mimic: Mapping[str, Mimic], path: Path) -> list[str]:
    """Return the joints that move, of all `joints` of a model: those `given`, or all that follow and lead no other.

    Raises
    ------
    UnknownNameError
        If a pattern fits no joint.
    ModelError
        If one that is given follows another, or is followed.
    """
    followers = {name: rule.leader for name, rule in mimic.items() if name in joints}
    leaders = {leader: name for name, leader in followers.items()}
    if not given:
        return [name for name in joints if name not in followers and name not in leaders]
    chosen = set()
    for pattern in given:
        fitting = fnmatch.filter(joints, pattern)
        if not fitting:
            raise UnknownNameError("joint", pattern, joints)
        chosen.update(fitting)
    for name in chosen:
        if name in followers or name in leaders:
            pair = f"follows '{followers[name]}'" if name in followers else f"is followed by '{leaders[name]}'"
            raise ModelError(f"{path}: joint '{name}' {pair} (mimic); leave both out of joints")
    return [name for name in joints if name in chosen]


def resting_position(joint: Joint) -> float:
    """Return the file's default position of a joint (rad or m), or the middle of its limits, if that lies outside."""
    value, low, high = (
        float(x[0]) for x in (joint.default_positions(), joint.position_lower_limits(), joint.position_upper_limits())
    )
    if low <= value <= high:
        return value
    return 0.5 * (low + high) if np.isfinite(low) and np.isfinite(high) else float(np.clip(value, low, high))


def held_position(
    name: str, joints: Mapping[str, Joint], given: Mapping[str, float], mimic: Mapping[str, Mimic]
) -> float:
    """Return where a joint stays (rad or m): as given, as the joint that it follows asks for, or at its own rest."""
    if name in given:
        return float(given[name])
    rule = mimic.get(name)
    if rule is None or rule.leader not in joints:
        return resting_position(joints[name])
    return rule.multiplier * held_position(rule.leader, joints, given, mimic) + rule.offset


def lock(plant: MultibodyPlant, joint: Joint, position: float | None = None) -> None:
    """Replace a joint of a plant that is not finalized by a weld at a position (rad or m)."""
    q = resting_position(joint) if position is None else position
    if isinstance(joint, RevoluteJoint):
        X_FM = RigidTransform(RotationMatrix(AngleAxis(q, joint.revolute_axis())), np.zeros(3))
    elif isinstance(joint, PrismaticJoint):
        X_FM = RigidTransform(q * joint.translation_axis())
    else:
        raise ModelError(f"joint '{joint.name()}' is {joint.type_name()}; only revolute and prismatic ones can be held")
    for index in plant.GetJointActuatorIndices():
        actuator = plant.get_joint_actuator(index)
        if actuator.joint().index() == joint.index():
            plant.RemoveJointActuator(actuator)
    name, frames = joint.name(), (joint.frame_on_parent(), joint.frame_on_child())
    plant.RemoveJoint(joint)
    plant.AddJoint(WeldJoint(name, *frames, X_FM))


def limits_by_joint(given: Values | None, joints: Sequence[str], what: str) -> dict[str, float]:
    """Return limits by joint, from an array in the joints' order or a mapping; they are positive.

    Raises
    ------
    UnknownNameError
        If a mapping names another joint.
    ModelError
        If an array has another size, or a limit is not positive.
    """
    if given is None:
        return {}
    if isinstance(given, Mapping):
        for name in given:
            if name not in joints:
                raise UnknownNameError("joint", name, joints)
        limits = {name: float(value) for name, value in given.items()}
    else:
        values = np.asarray(given, dtype=float)
        if values.shape != (len(joints),):
            raise ModelError(f"{what}: needs {len(joints)} entries ({', '.join(joints)}), got {values.shape}")
        limits = dict(zip(joints, values.tolist()))
    wrong = [name for name, value in limits.items() if not value > 0.0]
    if wrong:
        raise ModelError(f"{what}: must be > 0 for {', '.join(wrong)}")
    return limits


def add_actuators(
    plant: MultibodyPlant,
    instance: ModelInstanceIndex,
    given: Mapping[str, float],
    in_file: Mapping[str, float],
    path: Path,
) -> None:
    """Give every joint an actuator, in the order of the joints, with a finite effort limit."""
    actuated = {}
    for index in plant.GetJointActuatorIndices():  # by instance, the list is empty before Finalize
        actuator = plant.get_joint_actuator(index)
        if actuator.model_instance() == instance:
            actuated[actuator.joint().name()] = actuator
    missing = []
    for joint in joints_of(plant, instance):
        name = joint.name()
        limit = given.get(name, actuated[name].effort_limit() if name in actuated else in_file.get(name, np.inf))
        if not (np.isfinite(limit) and limit > 0.0):
            missing.append(name)
        elif name in actuated:
            actuated[name].set_effort_limit(limit)
        else:
            plant.AddJointActuator(name, joint, limit)
    if missing:
        raise ModelError(f"{path}: no finite effort limit > 0 for {', '.join(missing)}; pass effort_limits")
