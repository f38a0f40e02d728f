"""The tool that a wrist sensor carries: its weight and inertia, and what a robot's model says of it."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant

from saphari_drake.errors import UnknownNameError
from saphari_drake.parameters import require_non_negative, require_vector
from saphari_drake.robots.model import RobotModel

Array = NDArray[np.float64]


@dataclass
class ToolParameters:
    """What the sensor carries besides the person's hand, in the sensor frame S."""

    # kg.
    mass: float = 0.0
    # m; centre of mass.
    com: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    # kg m²; inertia about the centre of mass: Ixx, Iyy, Izz, Ixy, Ixz, Iyz.
    inertia: list[float] = field(default_factory=lambda: [0.0] * 6)

    def __post_init__(self) -> None:
        require_non_negative(self, "mass")
        require_vector(self, 3, "com")
        require_vector(self, 6, "inertia")


def tool_wrench(tool: ToolParameters, R_WS: Array, g_W: Array, rates_W: Array | None = None) -> Array:
    """Return what the tool's weight and inertia put on the sensor, (6,): moment (Nm) and force (N) at S, in S.

    f = m (g − a), τ = p × f − I α − ω × I ω, with the centre of mass at p.

    Parameters
    ----------
    tool : ToolParameters
    R_WS : (3, 3) array
        Orientation of the sensor.
    g_W : (3,) array
        Gravity (m/s²).
    rates_W : (3, 3) array, optional
        Acceleration of the centre of mass (m/s²), angular acceleration (rad/s²) and velocity (rad/s); zero if left out.
    """
    a, alpha, omega = np.zeros((3, 3)) if rates_W is None else rates_W @ R_WS
    xx, yy, zz, xy, xz, yz = tool.inertia
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    f = tool.mass * (R_WS.T @ g_W - a)
    return np.concatenate([np.cross(tool.com, f) - inertia @ alpha - np.cross(omega, inertia @ omega), f])


class SensorMount(NamedTuple):
    """Where a joint carries a tool."""

    link: int  # that moves with the joint's child
    X_LS: RigidTransform  # pose in it of the sensor's frame S: the joint's frame on its child
    tool: ToolParameters  # what the joint carries, at the default posture


def sensor_mount(robot: RobotModel, joint: str) -> SensorMount:
    """Return where a sensor of a joint's load sits, a weld's or the last joint's, and what the model puts on it.

    Raises
    ------
    UnknownNameError
        If there is no such joint.
    """
    plant = MultibodyPlant(0.0)
    instance = robot.add_to(plant)
    plant.Finalize()
    joints = {j.name(): j for j in map(plant.get_joint, plant.GetJointIndices(instance))}
    if joint not in joints:
        raise UnknownNameError("joint", joint, joints)
    child, S = joints[joint].child_body(), joints[joint].frame_on_child()
    context, bodies = plant.CreateDefaultContext(), [child.index()]
    for body in bodies:  # grows while it is run through
        bodies += [j.child_body().index() for j in joints.values() if j.parent_body().index() == body]
    link = robot.link_index(child.name())
    X_LS = S.CalcPose(context, plant.GetFrameByName(robot.link_names[link], instance))
    mass = sum(plant.get_body(index).get_mass(context) for index in bodies)
    if mass <= 0.0:
        return SensorMount(link, X_LS, ToolParameters())
    inertia = plant.CalcSpatialInertia(context, S, bodies)
    about = inertia.Shift(inertia.get_com()).CalcRotationalInertia()
    six = [*about.get_moments().tolist(), *about.get_products().tolist()]
    return SensorMount(link, X_LS, ToolParameters(float(mass), inertia.get_com().tolist(), six))
