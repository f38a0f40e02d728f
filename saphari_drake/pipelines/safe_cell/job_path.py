"""A job along a path that is carried out as far as it is allowed to: resumed, not restarted."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from saphari_drake.control.nmpc.parameters import NmpcReference
from saphari_drake.errors import ParameterError
from saphari_drake.messages import Immutable
from saphari_drake.robots.dynamics import DynamicsTerms, evaluate_dynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.systems import cycle, declare_outputs

Array = NDArray[np.float64]
Pose = Callable[[float], tuple[Array, Array]]


class Job(NamedTuple):
    """What an end effector does."""

    end_effector: str  # a frame of the robot
    pose: Pose  # job time (s) to rotation (3, 3) and position (3,) in the world
    length: float  # s, of the whole job at full speed


class _Memory(Immutable):
    def __init__(self, done: float, reference: NmpcReference) -> None:
        self.done, self.reference = done, reference


class JobPath(LeafSystem):
    """Asks for the poses of a job, as fast as it is allowed and as the end effector follows.

    .. pydrake_system::

        name: JobPath
        input_ports:
        - dynamics
        - speed_limit
        output_ports:
        - reference
        - progress

    Ports
    -----
    dynamics : abstract `DynamicsTerms`, of the measured state.
    speed_limit : 1, share of the job's speed that is allowed, from 0 to 1; not finite: 0.
    reference : abstract `NmpcReference`.
    progress : 1 (s), job time that is done.

    The job time advances with the limit, and more slowly while the end effector lags: not at all from `lag` on. The
    last pose holds.

    Parameters
    ----------
    robot : RobotModel
    job : Job
    period : float
        Of the controller that takes the reference (s).
    horizon : int
        Its number of steps.
    lag : float
        In m.
    """

    def __init__(self, robot: RobotModel, job: Job, period: float, horizon: int, lag: float = 0.08) -> None:
        super().__init__()
        if not lag > 0.0:
            raise ParameterError("lag", f"must be positive, got {lag}")
        self._job, self._period, self._horizon, self._lag = job, period, horizon, lag
        self._link, self._X_LF = robot.frame(job.end_effector)
        terms = evaluate_dynamics(robot, robot.home, np.zeros(robot.n))
        self._dynamics = self.DeclareAbstractInputPort("dynamics", AbstractValue.Make(terms))
        self._limit = self.DeclareVectorInputPort("speed_limit", BasicVector(1))
        start = _Memory(0.0, self._ahead(0.0, 0.0))
        self._memory = self.DeclareAbstractState(AbstractValue.Make(start))
        reads = {"reference": lambda m: m.reference, "progress": lambda m: [m.done]}
        declare_outputs(self, self._remembered, self.abstract_state_ticket(self._memory), start, reads)
        self.DeclarePeriodicUnrestrictedUpdateEvent(**cycle(period), update=self._update)

    def _remembered(self, context: Context) -> _Memory:
        memory: _Memory = context.get_abstract_state(int(self._memory)).get_value()
        return memory

    def _ahead(self, done: float, rate: float) -> NmpcReference:
        times = np.minimum(done + rate * self._period * np.arange(self._horizon + 2), self._job.length)
        poses = [self._job.pose(float(time)) for time in times]
        return NmpcReference(np.array([p for _, p in poses]), np.array([R for R, _ in poses]))

    def _update(self, context: Context, state: State) -> None:
        terms: DynamicsTerms = self._dynamics.Eval(context)
        before, limit = self._remembered(context), float(self._limit.Eval(context)[0])
        rate = min(max(limit, 0.0), 1.0) if np.isfinite(limit) and terms.finite else 0.0
        if rate > 0.0:
            tip = terms.position(self._link, self._X_LF.translation())
            behind = float(np.linalg.norm(tip - before.reference.p_WE[0]))
            rate *= max(0.0, 1.0 - behind / self._lag)
        done = min(before.done + rate * self._period, self._job.length)
        state.get_mutable_abstract_state(int(self._memory)).set_value(_Memory(done, self._ahead(done, rate)))
