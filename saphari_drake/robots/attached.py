"""What a user knows of an arm beside its model file: which joints move, their limits, a tool, a load."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, RigidBody, RotationalInertia, SpatialInertia

from saphari_drake.errors import ModelError, ParameterError, UnknownNameError
from saphari_drake.parameters import require_non_negative, require_positive, require_vector
from saphari_drake.robots.assembly import joints_of, lock, root_bodies

BALL = 0.04  # m; radius of a load without given inertia


@dataclass
class Payload:
    """A load without shape, fixed to the robot."""

    # kg; 0: none.
    mass: float = 0.0
    # m; its centre of mass in `frame`.
    centre: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    # kg m²; xx, yy, zz, or these and xy, xz, yz, about that centre in the axes of `frame`. Empty: of a ball of 4 cm.
    inertia: list[float] = field(default_factory=list)
    # Frame of the robot that carries it; empty: the last link.
    frame: str = ""

    def __post_init__(self) -> None:
        require_non_negative(self, "mass")
        require_vector(self, 3, "centre")
        if len(self.inertia):
            require_vector(self, 3 if len(self.inertia) == 3 else 6, "inertia")
        try:
            if self.mass > 0.0:
                self.spatial_inertia()
        except RuntimeError as error:
            raise ParameterError("inertia", f"no body of {self.mass} kg has {list(self.inertia)}") from error

    def spatial_inertia(self) -> SpatialInertia:
        """Return it about the origin of `frame`, in its axes."""
        moments = list(self.inertia) or [0.4 * self.mass * BALL**2] * 3
        central = RotationalInertia(*moments[:3], *([*moments[3:], 0.0, 0.0, 0.0][:3]))
        return SpatialInertia.MakeFromCentralInertia(self.mass, np.array(self.centre, float), central)

    def add_to(self, plant: MultibodyPlant, frame: Frame) -> None:
        """Add it to a plant that is not finalized."""
        if self.mass > 0.0:
            instance = frame.model_instance()
            name = f"load {len(plant.GetBodyIndices(instance))}"
            body = plant.AddRigidBody(name, instance, self.spatial_inertia())
            plant.WeldFrames(frame, body.body_frame(), RigidTransform())


@dataclass
class Tool:
    """A tool with a model file of its own, fixed to the robot; its joints, if it has any, do not move."""

    # URDF, SDF or MJCF with one model; empty: none.
    path: str = ""
    # Frame of the robot that carries its root; empty: the last link.
    frame: str = ""
    # m and deg; pose of its root in `frame`: x, y, z, roll, pitch, yaw.
    pose: list[float] = field(default_factory=lambda: [0.0] * 6)
    # rad or m; where its joints stay, by their names; the others stay where the file has them.
    joints: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        require_vector(self, 6, "pose")
        if self.path and not Path(self.path).is_file():
            raise ParameterError("path", f"no model file '{self.path}'")

    def add_to(self, plant: MultibodyPlant, parser: Parser, frame: Frame) -> None:
        """Add it to a plant that is not finalized.

        Raises
        ------
        ModelError
            If the file does not hold one model with one root.
        """
        if not self.path:
            return
        try:
            instances = parser.AddModels(str(self.path))
        except RuntimeError as error:
            raise ModelError(f"tool {self.path}: {error}") from error
        roots = root_bodies(plant, instances[0]) if len(instances) == 1 else []
        if len(roots) != 1:
            raise ModelError(f"tool {self.path}: needs one model with one root that is not fixed to the world")
        for joint in joints_of(plant, instances[0]):
            lock(plant, joint, self.joints.get(joint.name()))
        X_FT = RigidTransform(RollPitchYaw(np.deg2rad(self.pose[3:])), self.pose[:3])
        plant.WeldFrames(frame, roots[0].body_frame(), X_FT)


def attach(plant: MultibodyPlant, parser: Parser, parts: Sequence[Payload | Tool], last: RigidBody) -> None:
    """Fix parts to a robot in a plant that is not finalized; `last` is its last link.

    Raises
    ------
    UnknownNameError
        If the robot has no frame of the name that a part gives.
    """
    instance = last.model_instance()
    for part in parts:
        if part.frame and not plant.HasFrameNamed(part.frame, instance):
            frames = [plant.get_frame(index).name() for index in plant.GetFrameIndices(instance)]
            raise UnknownNameError("frame", part.frame, frames)
        frame = plant.GetFrameByName(part.frame, instance) if part.frame else last.body_frame()
        if isinstance(part, Payload):
            part.add_to(plant, frame)
        else:
            part.add_to(plant, parser, frame)


@dataclass
class ModelOptions:
    """What a scenario says of its robot beside the model file. Empty: as the file has it."""

    # Names of the joints that move, with * for any letters; the others stay where they are. Empty: all that follow and
    # lead no other.
    joints: list[str] = field(default_factory=list)
    # Nm (N) and rad/s (m/s); limits of these joints, in their order.
    effort_limits: list[float] = field(default_factory=list)
    velocity_limits: list[float] = field(default_factory=list)
    # Folders in which package:// addresses are searched before all others.
    package_dirs: list[str] = field(default_factory=list)
    tool: Tool = field(default_factory=Tool)
    payload: Payload = field(default_factory=Payload)

    def __post_init__(self) -> None:
        for name in ("effort_limits", "velocity_limits"):
            if len(getattr(self, name)):
                require_positive(self, name)
