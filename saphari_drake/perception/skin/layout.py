"""Where the modules of a sensitive skin lie on a link."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from saphari_drake.errors import ParameterError
from saphari_drake.math.primitives import nearest_surface_point
from saphari_drake.parameters import require_positive
from saphari_drake.robots.model import RobotModel

Array = NDArray[np.float64]

CELLS = 4
OPPOSITE = (1, 0, 3, 2, 7, 6, 5, 4)  # where a module stands among the neighbours of each of its own
MIN_CURVATURE_RADIUS = 0.02  # m; the deliverable gives 2–3 cm for its flexible circuit board


@dataclass
class SkinLayoutParameters:
    """A patch of modules, flat or bent around a cylinder; the default lies on the side of the LWR4's upper arm."""

    # Frame of the robot that the next three are given in: a link, or a frame fixed in one.
    frame: str = "link_3"
    # m; middle of the patch, on the surface.
    centre: list[float] = field(default_factory=lambda: [0.0, 0.065, 0.1])
    # Outward normal there.
    normal: list[float] = field(default_factory=lambda: [0.0, 1.0, 0.0])
    # Direction of the cylinder's axis, along which rows follow one another; its part along the normal is left out.
    axis: list[float] = field(default_factory=lambda: [0.0, 0.0, 1.0])
    # Modules along the axis and around it, ≥ 2 each; 6 × 6 in the deliverable.
    rows: int = 6
    columns: int = 6
    # m; spacing of the modules along the surface, > 0. Assumed.
    pitch: float = 0.008
    # m, ≥ 0.02; radius of the cylinder, infinite for a plane. That of the LWR4's link 3.
    curvature_radius: float = 0.065
    # m, > 0; how far modules may lie from the link's collision surface. Infinite: not checked.
    surface_tolerance: float = 0.003

    def __post_init__(self) -> None:
        require_positive(self, "rows", "columns", "pitch")
        for name in ("rows", "columns"):
            if getattr(self, name) != int(getattr(self, name)) or getattr(self, name) < 2:
                raise ParameterError(name, f"must be a whole number of at least 2, got {getattr(self, name)}")
        if not self.curvature_radius >= MIN_CURVATURE_RADIUS:
            raise ParameterError(
                "curvature_radius", f"the skin bends to {MIN_CURVATURE_RADIUS} m at most, got {self.curvature_radius}"
            )
        if self.columns * self.pitch > 2.0 * np.pi * self.curvature_radius:
            raise ParameterError("columns", f"{self.columns} do not fit around a radius of {self.curvature_radius} m")
        if not self.surface_tolerance > 0.0:
            raise ParameterError("surface_tolerance", f"must be positive, got {self.surface_tolerance}")
        for name in ("centre", "normal", "axis"):
            if np.shape(getattr(self, name)) != (3,) or not np.all(np.isfinite(getattr(self, name))):
                raise ParameterError(name, f"needs three finite numbers, got {getattr(self, name)}")
        if np.linalg.norm(np.cross(self.normal, self.axis)) < 1e-6:
            raise ParameterError("axis", "must not lie along the normal, nor may either be zero")


class SkinLayout:
    """Geometry of a skin patch in the frame of the link that carries it.

    Points of the patch have surface coordinates (u, v) in m, zero in its middle: u along the axis, v around it. Module
    ``row * columns + column`` covers the square of side `pitch` about its own (u, v).

    Parameters
    ----------
    robot : RobotModel
    params : SkinLayoutParameters, optional

    Attributes
    ----------
    link : int
        Link of the robot model.
    count : int
        Number of modules m.
    uv : (m, 2) array
        Surface coordinates of the modules' centres (m).
    p_LM, n_L : (m, 3) arrays
        Centres (m) and outward normals.
    R_LM : (m, 3, 3) array
        Orientation of the modules: x along u, y along v, z outwards.
    p_LP : (3,) array
        Middle of the patch (m).
    R_LP : (3, 3) array
        Orientation there.

    Raises
    ------
    ParameterError
        If modules lie farther from the link's collision surface than allowed, or the frame is fixed in the world.
    """

    def __init__(self, robot: RobotModel, params: SkinLayoutParameters | None = None) -> None:
        self.params = params = params or SkinLayoutParameters()
        self.link, X_LF = robot.frame(params.frame)
        if self.link < 0:
            raise ParameterError("frame", f"'{params.frame}' is fixed in the world; a skin needs a moving link")
        self.link_name = robot.link_names[self.link]
        self.rows, self.columns, self.pitch = int(params.rows), int(params.columns), float(params.pitch)
        self.count = self.rows * self.columns
        normal = np.asarray(params.normal, dtype=float) / np.linalg.norm(params.normal)
        axis = np.asarray(params.axis, dtype=float)
        axis = axis - (axis @ normal) * normal
        axis /= np.linalg.norm(axis)
        self.R_LP = X_LF.rotation().matrix() @ np.column_stack([axis, np.cross(normal, axis), normal])
        self.p_LP = np.array(X_LF @ np.asarray(params.centre, dtype=float))
        u = (np.arange(self.rows) - (self.rows - 1) / 2.0) * self.pitch
        v = (np.arange(self.columns) - (self.columns - 1) / 2.0) * self.pitch
        self.uv = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1).reshape(-1, 2)
        self.p_LM, self.R_LM = self.surface(self.uv)
        self.n_L = self.R_LM[:, :, 2].copy()
        if np.isfinite(params.surface_tolerance):
            self._require_on_surface(robot)

    def surface(self, uv: ArrayLike) -> tuple[Array, Array]:
        """Return the points (…, 3), m, and orientations (…, 3, 3) at surface coordinates (…, 2), in the link frame."""
        uv = np.asarray(uv, dtype=float)
        u, v = uv[..., 0], uv[..., 1]
        radius = self.params.curvature_radius
        p_P, R_P = np.zeros((*u.shape, 3)), np.zeros((*u.shape, 3, 3))
        angle = v / radius
        sin, cos = np.sin(angle), np.cos(angle)
        p_P[..., 0] = u
        if np.isfinite(radius):
            p_P[..., 1], p_P[..., 2] = radius * sin, -2.0 * radius * np.sin(angle / 2.0) ** 2
        else:
            p_P[..., 1] = v
        R_P[..., 0, 0] = 1.0
        R_P[..., 1, 1], R_P[..., 2, 1] = cos, -sin
        R_P[..., 1, 2], R_P[..., 2, 2] = sin, cos
        return self.p_LP + p_P @ self.R_LP.T, self.R_LP @ R_P

    def coordinates(self, p_L: ArrayLike) -> tuple[Array, Array]:
        """Return the surface coordinates (…, 2) of points (…, 3) near the patch, and their height above it (…), m."""
        p_P = (np.asarray(p_L, dtype=float) - self.p_LP) @ self.R_LP
        radius = self.params.curvature_radius
        if not np.isfinite(radius):
            return p_P[..., :2].copy(), p_P[..., 2]
        v = radius * np.arctan2(p_P[..., 1], p_P[..., 2] + radius)
        height = np.hypot(p_P[..., 1], p_P[..., 2] + radius) - radius
        return np.stack([p_P[..., 0], v], axis=-1), height

    @property
    def extent(self) -> Array:
        """Half extents of the patch along u and v (m), (2,)."""
        return 0.5 * self.pitch * np.array([self.rows, self.columns], dtype=float)

    @property
    def identity(self) -> Array:
        """Numbers that a calibration must agree with: rows, columns, pitch and curvature (1/m), (4,)."""
        return np.array([self.rows, self.columns, self.pitch, 1.0 / self.params.curvature_radius])

    def surface_distance(self, robot: RobotModel) -> Array:
        """Return the distance of each module's centre from the link's collision surface (m, negative inside), (m,)."""
        shapes = robot.shapes
        own = shapes.link == self.link
        if not np.any(own):
            return np.full(self.count, np.inf)
        nearest = (nearest_surface_point(shapes.kind, shapes.size, shapes.R_LS, shapes.p_LS, own, p) for p in self.p_LM)
        return np.array([distance for _, distance, _, _ in nearest])

    def _require_on_surface(self, robot: RobotModel) -> None:
        distance = self.surface_distance(robot)
        worst = int(np.argmax(np.abs(distance)))
        if abs(distance[worst]) > self.params.surface_tolerance:
            raise ParameterError(
                "centre",
                f"module {worst} of {self.count} lies {1e3 * distance[worst]:.1f} mm off the collision surface of "
                f"{self.link_name}; {1e3 * self.params.surface_tolerance:.1f} mm are allowed (surface_tolerance)",
            )


def neighbour_table(rows: int, columns: int) -> NDArray[np.int64]:
    """Return the eight neighbours of each module, (m, 8), −1 where there is none; those across a corner come last."""
    row, column = np.divmod(np.arange(rows * columns), columns)
    steps = [(-1, 0), (1, 0), (0, -1), (0, 1), (-1, -1), (-1, 1), (1, -1), (1, 1)]
    table = np.empty((rows * columns, 8), dtype=np.int64)
    for k, (di, dj) in enumerate(steps):
        i, j = row + di, column + dj
        inside = (i >= 0) & (i < rows) & (j >= 0) & (j < columns)
        table[:, k] = np.where(inside, i * columns + j, -1)
    return table
