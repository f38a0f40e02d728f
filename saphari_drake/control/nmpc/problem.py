"""The problem of Section 3 as data: eq. (9)–(22) for any robot, end effector, test points and weights."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform

from saphari_drake.control.nmpc.horizon import HorizonData, forward, place
from saphari_drake.errors import ModelError, ParameterError
from saphari_drake.math.rotations import rotation_between
from saphari_drake.math.tree import REVOLUTE
from saphari_drake.messages import NmpcReference, ObstaclePoints
from saphari_drake.parameters import diagonal, require_choice, require_non_negative, require_positive
from saphari_drake.robots.model import RobotModel

Array = NDArray[np.float64]


@dataclass
class NmpcParameters:
    """Numbers of the controller. Weights are diagonals: one value for all entries, or one an entry; A unless marked."""

    # s; sample time T_s. Deliverable.
    period: float = 0.1
    # Prediction steps N_p. Deliverable.
    horizon: int = 10
    # On (rad/s)² or (m/s)².
    Q_v: list[float] = field(default_factory=lambda: [0.05])
    # On the squared distance from home; one value for all spares joints without position limits, such as a platform's.
    Q_q: list[float] = field(default_factory=lambda: [0.02])
    # The same at the end of the horizon.
    R_q: list[float] = field(default_factory=lambda: [0.1])
    # On the pose error: x, y, z (1/m²) and twice the quaternion's vector part (1/rad²).
    Q_e: list[float] = field(default_factory=lambda: [20.0, 20.0, 20.0, 2.0, 2.0, 2.0])
    # The same at the end of the horizon.
    R_e: list[float] = field(default_factory=lambda: [100.0, 100.0, 100.0, 10.0, 10.0, 10.0])
    # Factor on the obstacle terms at the end of the horizon, eq. (21).
    r_O: float = 2.0
    # Whether distances are in the objective, eq. (18)–(21), with the c of each test point.
    obstacle_cost: bool = True
    # Whether they are constraints, eq. (22).
    obstacle_constraints: bool = True
    # m²; below this d² − d_min² the barrier goes on as its quadratic expansion, so that iterates may leave the domain.
    barrier_guard: float = 1.0e-3
    # Whether the constraints hold between the samples as well: see `nmpc_rows`.
    between_samples: bool = True
    # m; added to every minimum distance, for what the motion differs from the plan by (servo, obstacles' acceleration).
    clearance_margin: float = 0.0
    # Cost of 1 m² by which a constraint is violated; exact while it exceeds the multipliers.
    slack_penalty: float = 1.0e4
    # Rest posture (rad or m); empty: the robot's home.
    home: list[float] = field(default_factory=list)
    # 0 … 1, share of the robot's velocity limits that is used; one value, or one a joint.
    velocity_scale: list[float] = field(default_factory=lambda: [1.0])
    # rad/s² or m/s²; for braking. One value, or one a joint.
    acceleration_max: list[float] = field(default_factory=lambda: [5.0])
    # "sqp" (compiled), or the reference solvers "snopt" and "ipopt" on the MathematicalProgram.
    solver: str = "sqp"
    # Of the SQP: "active_set" (compiled, sparse), "daqp", or "osqp" and "clarabel" through a MathematicalProgram.
    qp_solver: str = "active_set"
    # "real_time": one iteration a step, more only where its result is not clear; "converged": until the tolerance.
    mode: str = "converged"
    # rad or m; largest entry of the step below which the SQP has converged.
    tolerance: float = 1.0e-4
    # Of the SQP, a control step.
    max_iterations: int = 30
    # Exact Hessian of the Lagrangian where it is positive definite, kept so by its factorization; else Gauss–Newton.
    exact_hessian: bool = True
    # Whether a command takes one period to compute, and is applied after it to the state predicted by then.
    delay_compensation: bool = False
    # Joints x, y and θ of a platform that cannot slip sideways; empty: there is none.
    nonholonomic: list[str] = field(default_factory=list)
    # Whether a robot that is nearer to an obstacle than allowed moves away, where it can, instead of braking.
    retreat: bool = False
    # s; obstacles seen longer ago than this count as lost.
    obstacle_timeout: float = 0.5

    def __post_init__(self) -> None:
        require_positive(self, "period", "barrier_guard", "slack_penalty", "velocity_scale", "acceleration_max")
        require_positive(self, "tolerance", "obstacle_timeout", "Q_v")
        require_non_negative(self, "Q_q", "R_q", "Q_e", "R_e", "r_O", "clearance_margin")
        for name in ("horizon", "max_iterations"):
            if getattr(self, name) < 1:
                raise ParameterError(name, f"must be at least 1, got {getattr(self, name)}")
        if np.max(self.velocity_scale) > 1.0:
            raise ParameterError("velocity_scale", f"must not exceed 1, got {self.velocity_scale}")
        require_choice(self, "solver", ("sqp", "snopt", "ipopt"))
        require_choice(self, "qp_solver", ("active_set", "daqp", "osqp", "clarabel"))
        require_choice(self, "mode", ("real_time", "converged"))
        if len(self.nonholonomic) not in (0, 3):
            raise ParameterError("nonholonomic", f"needs the joints x, y and theta, got {self.nonholonomic}")


@dataclass(frozen=True)
class TestPoint:
    """A point C of the robot that keeps a distance from obstacles.

    Attributes
    ----------
    name : str
    frame : str
        Frame or link that it is fixed in.
    p_FC : list of 3
        Where (m).
    d_min : float
        Distance to keep (m), from the surface of an obstacle.
    c : float
        Weight in the objective, eq. (20).
    """

    __test__ = False  # not a test, whatever pytest makes of its name

    name: str = ""
    frame: str = ""
    p_FC: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    d_min: float = 0.2
    c: float = 1.0e-4

    def __post_init__(self) -> None:
        require_positive(self, "d_min")
        require_non_negative(self, "c")
        if np.shape(self.p_FC) != (3,) or not np.all(np.isfinite(self.p_FC)):
            raise ParameterError("p_FC", f"needs 3 finite entries, got {self.p_FC}")


class NmpcProblem:
    """One robot with its task, as constants that a solver takes.

    Minimize over q_1 … q_N, with v_k = (q_{k+1} − q_k)/T_s, e the pose error and h the home posture::

        Σ_{k=0}^{N−1} v_kᵀQ_v v_k + Σ_{k=1}^{N−1} [(q_k − h)ᵀQ_q(q_k − h) + e_kᵀQ_e e_k + O_k]
                                  + (q_N − h)ᵀR_q(q_N − h) + e_NᵀR_e e_N + r_O O_N,
        O_k = Σ_ij c_i/(d_ijk² − d_min,i²)

    subject to |v_k| ≤ v_max, q_min ≤ q_k ≤ q_max, d_ijk² ≥ d_min,i², and −Δx sin θ̄ + Δy cos θ̄ = 0 for a platform that
    cannot slip. Corrected against the print: (15) pulls to a home posture, not to the origin, which would drag a
    platform there; in (17) the orientation's error is twice the vector part of the quaternion of R_refᵀR, as
    orientations have no differences.

    Parameters
    ----------
    robot : RobotModel
    end_effector : str
        Frame (or link) that follows the reference.
    test_points : sequence of TestPoint
    params : NmpcParameters, optional
    X_FE : RigidTransform, optional
        End effector in that frame.

    Attributes
    ----------
    data : HorizonData
    v_max, a_max, q_min, q_max, home : (n,) arrays

    Raises
    ------
    ModelError
        If a joint has no finite velocity limit, or the end effector does not move.
    """

    def __init__(
        self,
        robot: RobotModel,
        end_effector: str,
        test_points: Sequence[TestPoint],
        params: NmpcParameters | None = None,
        X_FE: RigidTransform | None = None,
    ) -> None:
        self.robot, self.test_points = robot, tuple(test_points)
        self.params = p = params or NmpcParameters()
        n = robot.n
        self.N, self.n = p.horizon, n
        unlimited = [name for name, v in zip(robot.joint_names, robot.v_max) if not (np.isfinite(v) and v > 0.0)]
        if unlimited:
            raise ModelError(f"{robot.name}: no finite velocity limit > 0 for joint {', '.join(unlimited)}")
        self.v_max = diagonal(p.velocity_scale, n, "velocity_scale") * robot.v_max
        self.a_max = diagonal(p.acceleration_max, n, "acceleration_max")
        self.q_min, self.q_max = robot.q_min.copy(), robot.q_max.copy()
        self.home = robot.checked_vector(p.home, "home") if len(p.home) else robot.home
        self.base = [robot.joint_index(name) for name in p.nonholonomic]
        self.data = self._data(end_effector, X_FE or RigidTransform())

    def _data(self, end_effector: str, X_FE: RigidTransform) -> HorizonData:
        robot, p, n = self.robot, self.params, self.n
        t = robot.tree
        align = [
            RigidTransform(_rotation(rotation_between(np.array([0.0, 0.0, 1.0]), axis)), [0, 0, 0]) for axis in t.axis
        ]
        X_ML = [a.inverse() @ _pose(R, x) for a, R, x in zip(align, t.R_ML, t.p_ML)]
        X_PM = [_pose(t.R_PF[j], t.p_PF[j]) @ align[j] for j in range(n)]
        X_PM = [X_ML[k] @ X if k >= 0 else X for k, X in zip(t.parent, X_PM)]
        chains = [_ancestors(t.parent, j) for j in range(n)]
        link_E, X_LF = robot.frame(end_effector)
        if link_E < 0:
            raise ModelError(f"{robot.name}: frame '{end_effector}' does not move")
        X_ME = X_ML[link_E] @ X_LF @ X_FE
        link_C, p_MC = [], []
        for point in self.test_points:
            link, X_LF = robot.frame(point.frame)
            if link < 0:
                raise ParameterError("frame", f"test point '{point.name}': frame '{point.frame}' does not move")
            link_C.append(link)
            p_MC.append(X_ML[link] @ X_LF @ np.array(point.p_FC, dtype=float))
        limited = np.isfinite(self.q_min) | np.isfinite(self.q_max)
        return HorizonData(
            revolute=(t.kind == REVOLUTE).astype(np.int64),
            parent=t.parent,
            chain=np.array([chain + [0] * (n - len(chain)) for chain in chains], dtype=np.int64),
            depth=np.array([len(chain) for chain in chains], dtype=np.int64),
            R_PM=np.array([X.rotation().matrix() for X in X_PM]),
            p_PM=np.array([X.translation() for X in X_PM]),
            link_E=int(link_E),
            R_ME=np.ascontiguousarray(X_ME.rotation().matrix()),
            p_ME=np.array(X_ME.translation()),
            link_C=np.array(link_C, dtype=np.int64),
            p_MC=np.array(p_MC, dtype=float).reshape(-1, 3),
            d_min=np.array([point.d_min + p.clearance_margin for point in self.test_points], dtype=float),
            c=np.array([point.c for point in self.test_points], dtype=float),
            period=float(p.period),
            Q_v=diagonal(p.Q_v, n, "Q_v"),
            Q_q=_posture_weight(p.Q_q, limited, "Q_q"),
            Q_e=diagonal(p.Q_e, 6, "Q_e"),
            R_q=_posture_weight(p.R_q, limited, "R_q"),
            R_e=diagonal(p.R_e, 6, "R_e"),
            r_O=float(p.r_O),
            home=self.home,
            q_min=self.q_min,
            q_max=self.q_max,
            v_max=self.v_max,
            guard=float(p.barrier_guard),
            cost_on=bool(p.obstacle_cost),
            rows_on=bool(p.obstacle_constraints),
            swept=bool(p.between_samples),
            base=np.array(self.base, dtype=np.int64),
        )

    def end_effector_pose(self, q: Array) -> tuple[Array, Array]:
        """Return R_WE (3, 3) and p_WE (3,) at joint positions `q`."""
        R, p, x = np.empty((self.n, 3, 3)), np.empty((self.n, 3)), np.empty(3)
        forward(self.data, np.asarray(q, dtype=float), R, p)
        place(R[self.data.link_E], p[self.data.link_E], self.data.p_ME, x)
        return R[self.data.link_E] @ self.data.R_ME, x

    def stages(self, reference: NmpcReference, first: int = 0) -> tuple[Array, Array]:
        """Return R (N + 1, 3, 3) and p (N + 1, 3) of the reference from row `first` on; its last row holds."""
        rows = np.minimum(np.arange(first, first + self.N + 1), len(reference.p_WE) - 1)
        return np.ascontiguousarray(reference.R_WE[rows]), np.ascontiguousarray(reference.p_WE[rows])

    def predict(self, obstacles: ObstaclePoints, age: float = 0.0) -> tuple[Array, Array]:
        """Return positions (N + 1, m, 3) at constant velocity, and radii; `age` (s): how long ago they were seen."""
        times = age + self.params.period * np.arange(self.N + 1)
        p_WO, v_WO = np.asarray(obstacles.p_WO, dtype=float), np.asarray(obstacles.v_WO, dtype=float)
        return p_WO[None] + times[:, None, None] * v_WO[None], np.ascontiguousarray(obstacles.radius, dtype=float)


def _pose(R: Array, p: Array) -> RigidTransform:
    X = np.eye(4)
    X[:3, :3], X[:3, 3] = R, p
    return RigidTransform(X)


def _rotation(R: Array):
    return _pose(R, np.zeros(3)).rotation()


def _ancestors(parent: NDArray[np.int64], link: int) -> list[int]:
    chain = [link]
    while parent[chain[-1]] >= 0:
        chain.append(int(parent[chain[-1]]))
    return chain[::-1]


def _posture_weight(value: list[float], limited: NDArray[np.bool_], name: str) -> Array:
    weight = diagonal(value, len(limited), name)
    return weight * limited if len(value) == 1 else weight
