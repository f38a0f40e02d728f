"""The whole nonlinear problem of a horizon as a MathematicalProgram, for SNOPT or IPOPT: the reference of the SQP."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from pydrake.autodiffutils import AutoDiffXd, ExtractGradient, ExtractValue
from pydrake.solvers import IpoptSolver, MathematicalProgram, SnoptSolver, SolutionResult, SolverOptions

from saphari_drake.control.nmpc.data import HorizonData, Scene, no_multipliers
from saphari_drake.control.nmpc.horizon import evaluate
from saphari_drake.control.nmpc.limits import position_limits
from saphari_drake.control.nmpc.rows import distance_rows, kept_distances, slip_rows
from saphari_drake.control.nmpc.solvers.subproblem import QpStatus, Rows, spread

Array = NDArray[np.float64]


class HorizonProgram:
    """The problem of `law`, each term a cost or constraint of its own with exact gradients; distances are hard.

    It is built once, and each step writes its numbers into it.

    Parameters
    ----------
    data : HorizonData
    N : int
        Stages.
    solver : str
        "snopt" or "ipopt".
    iterations : int
        Most (major) iterations.

    Attributes
    ----------
    program : MathematicalProgram
    q : (N, n) array of Variable
        Joint positions of stages 1 … N.
    """

    def __init__(self, data: HorizonData, N: int, solver: str, iterations: int = 1000) -> None:
        n = len(data.Q_v)
        self.data, self.program = data, MathematicalProgram()
        self.q = self.program.NewContinuousVariables(N, n, "q")
        self._scene: Scene
        self._options = SolverOptions()
        self._solver = SnoptSolver() if solver == "snopt" else IpoptSolver()
        own = {"tol": 1e-9, "max_iter": iterations}
        if solver == "snopt":
            own = {"Major optimality tolerance": 1e-8, "Major feasibility tolerance": 1e-9}
            own["Major iterations limit"] = iterations
        for name, value in own.items():
            self._options.SetOption(self._solver.id(), name, value)
        self._reach = data.period * data.v_max
        self._add_stages()
        self._distances = None
        if len(data.base):
            self._constrain("slip", N, 0.0, lambda Q: slip_rows(data, self._scene.q0, Q))

    def _add_stages(self) -> None:
        """Add costs and limits stage by stage."""
        data, add, (N, n) = self.data, self.program, self.q.shape
        D, Q_v = np.hstack([np.eye(n), -np.eye(n)]), np.diag(data.Q_v) / data.period**2
        self._limits, self._changes = [], []
        T, change = np.hstack([np.eye(n), -2.0 * np.eye(n), np.eye(n)]), data.period * data.change
        bounded = np.isfinite(change).all()
        for k, q in enumerate(self.q, 1):
            if k == 1:
                velocity = self._first = add.AddQuadraticErrorCost(Q_v, data.home, q)
                self._start = add.AddBoundingBoxConstraint(-self._reach, self._reach, q)
            else:
                pair = np.concatenate([q, self.q[k - 2]])
                velocity = add.AddQuadraticCost(2.0 * D.T @ Q_v @ D, np.zeros(2 * n), pair, is_convex=True)
                add.AddLinearConstraint(D, -self._reach, self._reach, pair)
            velocity.evaluator().set_description(f"velocity {k}")
            if bounded:
                here = np.concatenate(self.q[max(k - 3, 0) : k][::-1])
                self._changes.append(add.AddLinearConstraint(T[:, : len(here)], -change, change, here))
            posture = np.diag(data.R_q if k == N else data.Q_q)
            add.AddQuadraticErrorCost(posture, data.home, q).evaluator().set_description(f"posture {k}")
            self._limits.append(add.AddBoundingBoxConstraint(data.q_min, data.q_max, q))
            for name, term in _terms(data, k == N).items():
                cost = add.AddCost(self._cost(term, k), vars=q)
                cost.evaluator().set_description(f"{name} {k}")

    def update(self, scene: Scene) -> None:
        """Write the numbers of one control step into the program."""
        data, q0, before = self.data, scene.q0, self._scene if self._distances else None
        self._scene = scene
        Q_v = np.diag(data.Q_v) / data.period**2
        self._first.evaluator().UpdateCoefficients(2.0 * Q_v, -2.0 * Q_v @ q0, q0 @ Q_v @ q0)
        self._start.evaluator().set_bounds(q0 - self._reach, q0 + self._reach)
        for limit, low, high in zip(self._limits, *position_limits(data, q0, scene.v0, len(self.q))):
            limit.evaluator().set_bounds(low, high)
        for change, known in zip(self._changes, (-q0 - data.period * scene.v0, q0)):
            turn = data.period * data.change
            change.evaluator().set_bounds(-turn - known, turn - known)
        if before is not None and len(before.radius) != len(scene.radius):
            self.program.RemoveConstraint(self._distances)
            self._distances = None
        count = len(self.q) * len(data.link_C) * len(scene.radius)
        if data.rows_on and count and self._distances is None:
            self._distances = self._constrain("distances", count, np.inf, self._rows)

    def solve(self, scene: Scene, guess: Array) -> tuple[Array, QpStatus]:
        """Return the solution (N, n) of one control step from a guess (N, n), and what the solver says of it.

        That is EXHAUSTED wherever the solver ends neither with a solution nor with a proof that there is none.
        """
        self.update(scene)
        self.program.SetInitialGuess(self.q, guess)
        result = self._solver.Solve(self.program, None, self._options)
        status = QpStatus.SOLVED if result.is_success() else QpStatus.EXHAUSTED
        if result.get_solution_result() == SolutionResult.kInfeasibleConstraints:
            status = QpStatus.INFEASIBLE
        return result.GetSolution(self.q.ravel()).reshape(self.q.shape), status

    def _constrain(self, name: str, count: int, high: float, rows: Callable[[Array], Rows]):
        """Add the constraint 0 ≤ z ≤ high on all stages, with z and its gradient from `rows`."""
        N, n = self.q.shape

        def evaluate_rows(q: NDArray) -> NDArray:
            found = rows(_values(q).reshape(N, n))
            return _with_gradient(q, found.z, spread(found, N))

        bounds = np.zeros(count), np.full(count, high)
        binding = self.program.AddConstraint(evaluate_rows, *bounds, vars=self.q.ravel())
        binding.evaluator().set_description(name)
        return binding

    def _rows(self, Q: Array) -> Rows:
        data, scene, none = self.data, self._scene, no_multipliers(self._scene, *self.q.shape)
        at = evaluate(data._replace(cost_on=False), scene, Q, none, False, True)
        return distance_rows(data, scene, Q, at, kept_distances(data, scene.q0, Q, at.J), np.inf, True)

    def _cost(self, term: HorizonData, k: int) -> Callable[[NDArray], object]:
        """Return the cost of stage k as a function of its positions, of numbers or AutoDiffXd."""

        def cost(q: NDArray) -> object:
            x, s = _values(q), self._scene
            stage = Scene(x, s.R_ref[[k, k]], s.p_ref[[k, k]], s.p_WO[[k, k]], s.radius, s.v0)
            at = evaluate(term, stage, x[None], no_multipliers(stage, 1, len(x)), False, True)
            return _with_gradient(q, np.array([at.f]), at.g)[0]

        return cost


def _terms(data: HorizonData, last: bool) -> dict[str, HorizonData]:
    """Return the problem of one stage with the pose error alone, and with the obstacles alone."""
    none = np.zeros(len(data.Q_v))
    only = data._replace(
        Q_v=none, R_q=none, R_e=data.R_e if last else data.Q_e, r_O=data.r_O if last else 1.0, base=data.base[:0]
    )
    terms = {"pose": only._replace(cost_on=False)}
    if data.cost_on:
        terms["obstacles"] = only._replace(R_e=np.zeros(6))
    return terms


def _values(q: NDArray) -> Array:
    return ExtractValue(q).ravel() if q.dtype == object else np.array(q, dtype=float)


def _with_gradient(q: NDArray, value: Array, G: Array) -> NDArray:
    """Return `value` as it is, or as AutoDiffXd by the chain rule with its gradient `G` in q."""
    if q.dtype != object:
        return value
    D = G @ ExtractGradient(q)
    return np.array([AutoDiffXd(v, d) for v, d in zip(value, D)])
