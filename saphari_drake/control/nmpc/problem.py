"""The numbers of the problem in `law`, for one robot with its task, as constants for the kernels."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform

from saphari_drake.control.nmpc.data import HorizonData, Scene
from saphari_drake.control.nmpc.kinematics import empty_frames, forward, place
from saphari_drake.control.nmpc.parameters import NmpcParameters, NmpcReference, TestPoint
from saphari_drake.control.nmpc.solvers.program import HorizonProgram
from saphari_drake.errors import ModelError, ParameterError
from saphari_drake.math.rotations import rotation_between, rotation_exp, rotation_log
from saphari_drake.math.tree import REVOLUTE
from saphari_drake.messages import ObstaclePoints
from saphari_drake.parameters import diagonal
from saphari_drake.robots.model import RobotModel

Array = NDArray[np.float64]


class NmpcProblem:
    """The problem of `law` for one robot with its task.

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
    program : HorizonProgram or None
        The whole problem for SNOPT or IPOPT, if the parameters name one of them.
    N, n : int
        Stages and joints.
    a_max : (n,) array
        Accelerations (rad/s² or m/s²) for braking.

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
        self.N, self.n = p.horizon, robot.n
        self.a_max = diagonal(p.acceleration_max, robot.n, "acceleration_max")
        self.data = self._data(end_effector, X_FE or RigidTransform())
        self.program = HorizonProgram(self.data, self.N, p.solver) if p.solver in ("snopt", "ipopt") else None

    def _data(self, end_effector: str, X_FE: RigidTransform) -> HorizonData:
        robot, p, n, t = self.robot, self.params, self.n, self.robot.tree
        unlimited = [name for name, v in zip(robot.joint_names, robot.v_max) if not (np.isfinite(v) and v > 0.0)]
        if unlimited:
            raise ModelError(f"{robot.name}: no finite velocity limit > 0 for joint {', '.join(unlimited)}")
        # M is the joint's frame F turned so that its z axis is the joint's.
        X_FM = [_pose(rotation_between(np.array([0.0, 0.0, 1.0]), axis), np.zeros(3)) for axis in t.axis]
        X_ML = [X.inverse() @ _pose(R, x) for X, R, x in zip(X_FM, t.R_ML, t.p_ML)]
        X_PM = [_pose(t.R_PF[j], t.p_PF[j]) @ X_FM[j] for j in range(n)]
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
        limited = np.isfinite(robot.q_min) | np.isfinite(robot.q_max)
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
            pull=np.square(diagonal(p.pull_linear, 2, "pull_linear")) / 3.0,
            R_q=_posture_weight(p.R_q, limited, "R_q"),
            R_e=diagonal(p.R_e, 6, "R_e"),
            r_O=float(p.r_O),
            home=robot.checked_vector(p.home, "home") if len(p.home) else robot.home.copy(),
            q_min=robot.q_min.copy(),
            q_max=robot.q_max.copy(),
            v_max=diagonal(p.velocity_scale, n, "velocity_scale") * robot.v_max,
            change=p.ramp * p.period * self.a_max if p.ramp > 0.0 else np.full(n, np.inf),
            guard=float(p.barrier_guard),
            cost_on=bool(p.obstacle_cost),
            rows_on=bool(p.obstacle_constraints),
            swept=bool(p.between_samples),
            base=np.array([robot.joint_index(name) for name in p.nonholonomic], dtype=np.int64),
        )

    def end_effector_pose(self, q: Array) -> tuple[Array, Array]:
        """Return R_WE (3, 3) and p_WE (3,) at joint positions `q`."""
        data, at, x = self.data, empty_frames(self.n), np.empty(3)
        forward(data, np.asarray(q, dtype=float), at)
        place(at.R[data.link_E], at.p[data.link_E], data.p_ME, x)
        return at.R[data.link_E] @ data.R_ME, x

    def scene(
        self,
        q0: Array,
        reference: NmpcReference,
        obstacles: ObstaclePoints,
        age: float = 0.0,
        first: int = 0,
        v0: Array | None = None,
    ) -> Scene:
        """Return the inputs of a step as arrays of the stages.

        The first is `first` periods and half a ramp from now. The reference's last row holds; obstacles, seen `age` (s)
        ago, move at constant velocity; their radii grow by what `obstacle_acceleration` can add until the end of the
        first period. Without `v0` the robot stands before the horizon begins.
        """
        stages = np.arange(first, first + self.N + 1)
        ahead = 0.5 * self.params.ramp
        times = age + self.params.period * (stages + ahead)
        p_WO, v_WO = np.asarray(obstacles.p_WO, dtype=float), np.asarray(obstacles.v_WO, dtype=float)
        moved = p_WO.T[None] + times[:, None, None] * v_WO.T[None]
        R_WE, p_WE = _between_rows(reference, stages, ahead)
        unforeseen = age + self.params.period * (first + 1)
        radius = np.asarray(obstacles.radius) + 0.5 * self.params.obstacle_acceleration * unforeseen**2
        parts = q0, R_WE, p_WE, moved, radius, np.zeros(self.n) if v0 is None else v0
        return Scene(*(np.ascontiguousarray(part, dtype=float) for part in parts))


def _between_rows(reference: NmpcReference, stages: NDArray[np.int64], share: float) -> tuple[Array, Array]:
    """Return R (m, 3, 3) and p (m, 3) of a reference at `stages` and that share of the way to the next ones."""
    last = len(reference.p_WE) - 1
    a, b = np.minimum(stages, last), np.minimum(stages + 1, last)
    R, p = reference.R_WE[a], reference.p_WE[a]
    if share > 0.0:
        p = p + share * (reference.p_WE[b] - p)
        R = np.array([X @ rotation_exp(share * rotation_log(X.T @ Y)) for X, Y in zip(R, reference.R_WE[b])])
    return R, p


def _pose(R: Array, p: Array) -> RigidTransform:
    X = np.eye(4)
    X[:3, :3], X[:3, 3] = R, p
    return RigidTransform(X)


def _ancestors(parent: NDArray[np.int64], link: int) -> list[int]:
    chain = [link]
    while parent[chain[-1]] >= 0:
        chain.append(int(parent[chain[-1]]))
    return chain[::-1]


def _posture_weight(value: list[float], limited: NDArray[np.bool_], name: str) -> Array:
    weight = diagonal(value, len(limited), name)
    return weight * limited if len(value) == 1 else weight
