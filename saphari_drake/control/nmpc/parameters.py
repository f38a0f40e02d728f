"""Parameters of the predictive controller, its test points, its reference and its status."""

from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from saphari_drake.errors import ParameterError
from saphari_drake.messages import Immutable
from saphari_drake.parameters import require_choice, require_non_negative, require_positive, require_within


class NmpcStatus(IntEnum):
    """What the predictive controller does, also published as a number."""

    SOLVED = 0  # converged within the tolerance
    REAL_TIME = 1  # one iteration, as asked
    UNCONVERGED = 2  # a limit of iterations came first; what is applied is clear all the same
    SLACK = 3  # some predicted distance is below its minimum; what is applied is clear
    BRAKING = 4  # no clear motion was found: brake
    START_INSIDE = 5  # nearer to an obstacle than allowed already: brake, or retreat if that is wanted
    BAD_INPUT = 6  # an input is not finite, or has a wrong size: brake
    OBSTACLES_LOST = 7  # the source of the obstacles is lost or too old: brake
    WAITING = 8  # no cycle yet: at rest
    UNSOLVED = 9  # a problem without solution, or a matrix that is not positive definite: brake
    RETREATING = 10  # no clear motion was found; with `retreat`, the plan leaves more room than braking and is applied


@dataclass(frozen=True)
class NmpcReference(Immutable):
    """Desired poses of an end effector over a horizon.

    Attributes
    ----------
    p_WE : (m, 3) array
        Positions (m); row k is for k control periods from now. Where rows are lacking, the last one holds, so that one
        row is a target that stays. With delay compensation, one row more than the horizon's N + 1 is used.
    R_WE : (m, 3, 3) array
        Orientations.
    """

    p_WE: NDArray[np.float64] = field(default_factory=lambda: np.zeros((1, 3)))
    R_WE: NDArray[np.float64] = field(default_factory=lambda: np.eye(3)[None])


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
    # m, rad; pose errors beyond which their cost grows linearly, so that a pose that is held firmly does not pull from
    # afar harder than obstacles push; 0: quadratic everywhere, as published.
    pull_linear: list[float] = field(default_factory=lambda: [0.0, 0.0])
    # Factor on the obstacle terms at the end of the horizon, eq. (21).
    r_O: float = 2.0
    # Whether distances are in the objective, eq. (18)–(21), with the c of each test point.
    obstacle_cost: bool = True
    # Whether they are constraints, eq. (22).
    obstacle_constraints: bool = True
    # m²; below this d² − d_min² the barrier goes on as its quadratic expansion, so that iterates may leave the domain.
    barrier_guard: float = 1.0e-3
    # Whether the constraints hold between the samples as well: see `rows`.
    between_samples: bool = True
    # m; added to every minimum distance, for what the motion differs from the plan by (servo, obstacles' acceleration).
    clearance_margin: float = 0.0
    # m/s²; with which obstacles may leave their predicted ways, from when they were seen until a command takes effect.
    obstacle_acceleration: float = 0.0
    # Cost of 1 m² by which a constraint is violated; exact while it exceeds the multipliers, which grow with Q_e, R_e.
    slack_penalty: float = 1.0e4
    # Rest posture (rad or m); empty: the robot's home.
    home: list[float] = field(default_factory=list)
    # 0 … 1, share of the robot's velocity limits that is used; one value, or one a joint.
    velocity_scale: list[float] = field(default_factory=lambda: [1.0])
    # rad/s² or m/s²; for braking, and with `ramp` for all that is commanded. One value, or one a joint.
    acceleration_max: list[float] = field(default_factory=lambda: [5.0])
    # 0 … 1, share of a period over which a command goes from the one before to its own, with that acceleration at most;
    # 0: at once, and by any amount, as published. See `limits`.
    ramp: float = 0.0
    # SQP with the compiled "active_set" or with "daqp"; or "snopt" or "ipopt" on a MathematicalProgram of the whole
    # problem, whose distance constraints have no slack, and to which tolerance, mode and iterations do not apply.
    solver: str = "active_set"
    # "real_time": one iteration a step, more only where its result is not clear; "converged": until the tolerance.
    mode: str = "converged"
    # rad or m; largest entry of the step below which the SQP has converged.
    tolerance: float = 1.0e-4
    # Of the SQP, a control step.
    max_iterations: int = 30
    # s; wall time after which "active_set" begins no other iteration, so that a run no longer repeats; 0: none.
    deadline: float = 0.0
    # Exact Hessian of the Lagrangian where it is positive definite, kept so by its factorization; else Gauss–Newton.
    exact_hessian: bool = True
    # Whether a command takes one period to compute, and is applied after it to the state predicted by then.
    delay_compensation: bool = False
    # Joints x, y and θ of a platform that cannot slip sideways; empty: there is none.
    nonholonomic: list[str] = field(default_factory=list)
    # Whether a robot that is, or comes, nearer to an obstacle than allowed follows its plan instead of braking, where
    # that leaves more room.
    retreat: bool = False
    # s; obstacles seen longer ago than this count as lost.
    obstacle_timeout: float = 0.5

    def __post_init__(self) -> None:
        require_positive(self, "period", "barrier_guard", "slack_penalty", "velocity_scale", "acceleration_max")
        require_positive(self, "tolerance", "obstacle_timeout", "Q_v")
        require_non_negative(self, "Q_q", "R_q", "Q_e", "R_e", "pull_linear", "r_O", "clearance_margin")
        require_non_negative(self, "obstacle_acceleration", "deadline")
        require_within(self, 1, 1000, "horizon", "max_iterations")
        if np.max(self.velocity_scale) > 1.0:
            raise ParameterError("velocity_scale", f"must not exceed 1, got {self.velocity_scale}")
        if not 0.0 <= self.ramp <= 1.0:
            raise ParameterError("ramp", f"must lie in [0, 1], got {self.ramp}")
        require_choice(self, "solver", ("active_set", "daqp", "snopt", "ipopt"))
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
