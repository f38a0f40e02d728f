"""The tool that a wrist sensor carries: its weight and inertia, and how static postures show them."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Joint, JointIndex

from saphari_drake.errors import ParameterError, StateError
from saphari_drake.parameters import require_non_negative

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
        for name, size in {"com": 3, "inertia": 6}.items():
            if np.shape(getattr(self, name)) != (size,) or not np.all(np.isfinite(getattr(self, name))):
                raise ParameterError(name, f"needs {size} finite numbers, got {getattr(self, name)}")


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


class ToolIdentification(NamedTuple):
    """A tool as static postures show it."""

    tool: ToolParameters
    bias: Array  # (6,) moment (Nm) and force (N) of the sensor without load
    residual_torque: float  # Nm, root mean square
    residual_force: float  # N, root mean square


def identify_tool(R_WS: Array, wrenches: Array, g_W: Array) -> ToolIdentification:
    """Identify mass, centre of mass and bias from readings at rest, by least squares.

    f = m g_S + b_f and τ = (m p) × g_S + b_τ are linear in m, m p and the bias.

    Parameters
    ----------
    R_WS : (k, 3, 3) array
        Orientations of the sensor.
    wrenches : (k, 6) array
        Readings (Nm, N) at S, in S, while nobody touches.
    g_W : (3,) array
        Gravity (m/s²).

    Raises
    ------
    StateError
        If sizes differ, numbers are not finite, or the orientations do not tell the unknowns apart: four, whose
        gravity directions do not lie in one plane of the sensor frame, are enough.
    """
    R_WS, wrenches = np.asarray(R_WS, dtype=float), np.asarray(wrenches, dtype=float)
    k = len(R_WS)
    if R_WS.shape != (k, 3, 3) or wrenches.shape != (k, 6):
        raise StateError(f"postures: {R_WS.shape} orientations do not go with {wrenches.shape} wrenches")
    if not (np.all(np.isfinite(R_WS)) and np.all(np.isfinite(wrenches))):
        raise StateError("postures: orientations or wrenches are not finite")
    g_S = np.einsum("kij,i->kj", R_WS, g_W)
    A = np.zeros((k, 6, 10))
    for row, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):  # τ = (m p) × g
        A[:, row, 1 + i], A[:, row, 1 + j] = g_S[:, j], -g_S[:, i]
    A[:, 3:, 0] = g_S
    A[:, np.arange(6), 4 + np.arange(6)] = 1.0
    rows = A.reshape(-1, 10)
    scaled = rows / np.maximum(np.linalg.norm(rows, axis=0), 1e-12)
    if k == 0 or np.linalg.svd(scaled, compute_uv=False)[-1] < 1e-3:
        raise StateError("postures: mass, centre of mass and bias cannot be told apart; turn the sensor farther")
    x = np.linalg.lstsq(rows, wrenches.ravel(), rcond=None)[0]
    if x[0] <= 0.0:
        raise StateError(f"postures: the readings give a mass of {x[0]:.3g} kg")
    error = wrenches - A @ x
    torque, force = (float(np.sqrt(np.mean(part**2))) for part in (error[:, :3], error[:, 3:]))
    tool = ToolParameters(float(x[0]), (x[1:4] / x[0]).tolist())
    return ToolIdentification(tool, np.array(x[4:], dtype=float), torque, force)


def tool_of_plant(plant: MultibodyPlant, joint: Joint) -> ToolParameters:
    """Return the lumped inertia of the bodies outboard of a joint, in its child frame, at the default posture."""
    context, bodies = plant.CreateDefaultContext(), [joint.child_body().index()]
    joints = [plant.get_joint(JointIndex(i)) for i in plant.GetJointIndices()]
    for body in bodies:  # grows while it is run through
        bodies += [j.child_body().index() for j in joints if j.parent_body().index() == body]
    mass = sum(plant.get_body(index).get_mass(context) for index in bodies)
    if mass <= 0.0:
        return ToolParameters()
    inertia = plant.CalcSpatialInertia(context, joint.frame_on_child(), bodies)
    about = inertia.Shift(inertia.get_com()).CalcRotationalInertia()
    return ToolParameters(
        float(mass), inertia.get_com().tolist(), [*about.get_moments().tolist(), *about.get_products().tolist()]
    )
