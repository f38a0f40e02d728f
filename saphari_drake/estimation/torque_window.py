"""The torque that changes a sampled momentum, from the torques of a faster cycle."""

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from saphari_drake.errors import ParameterError
from saphari_drake.systems import cycle

Array = NDArray[np.float64]


def window_weights(count: int, differenced: bool) -> Array:
    """Return the weights of the last torques, the oldest first, whose mean changes a velocity from sample to sample.

    With semi-implicit steps h and q̈_j over each, sampled velocities change by Σ h q̈_j over a period of `count` steps.
    Differences of positions, (q_k − q_{k−N})/(N h), change by Σ_j h q̈_j min(j, 2N − j)/N over j = 1 … 2N − 1: the last
    two periods but for one step, their middle the most.

    Parameters
    ----------
    count : int
        N, steps of the torque in a period of the velocity (≥ 1).
    differenced : bool
        Whether velocities are differences of sampled positions.

    Returns
    -------
    (N,) or (2N − 1,) array
        Sum 1.
    """
    if count < 1:
        raise ParameterError("count", f"must be at least 1, got {count}")
    j = np.arange(1.0, 2 * count)
    return np.minimum(j, 2 * count - j) / count**2 if differenced else np.full(count, 1.0 / count)


class TorqueWindow(LeafSystem):
    """Mean torque of the steps that changed a sampled velocity, for a `MomentumObserver` that is told of no delay.

    .. pydrake_system::

        name: TorqueWindow
        input_ports:
        - torque_acting
        output_ports:
        - torque_mean

    Ports
    -----
    torque_acting : n (Nm or N), the torque over each step, of a `JointEnvelope`; the first one counts before the start.
    torque_mean : n (Nm or N), by `window_weights`, with the step that ends now as the last.

    Parameters
    ----------
    n : int
        Number of joints.
    step, period : float
        Of torque and velocity (s), the second a multiple of the first.
    differenced : bool
        Whether velocities are differences of sampled positions.
    """

    def __init__(self, n: int, step: float, period: float, differenced: bool) -> None:
        super().__init__()
        count = period / step
        if abs(count - round(count)) > 1e-6:
            raise ParameterError("period", f"must be a multiple of the step {step} s, got {period}")
        self._weights = window_weights(round(count), differenced)
        self._torque = self.DeclareVectorInputPort("torque_acting", BasicVector(n))
        self._past = self.DeclareDiscreteState(len(self._weights) * n)
        tickets = {self._torque.ticket(), self.discrete_state_ticket(self._past)}
        self.DeclareVectorOutputPort("torque_mean", BasicVector(n), self._calc, tickets)
        self.DeclareInitializationUnrestrictedUpdateEvent(self._start)
        self.DeclarePeriodicUnrestrictedUpdateEvent(**cycle(step), update=self._update)

    def _window(self, context: Context) -> Array:
        torque = np.array(self._torque.Eval(context))
        past = context.get_discrete_state(self._past).value().reshape(-1, len(torque))
        return np.vstack([past[1:], torque])

    def _calc(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._weights @ self._window(context))

    def _start(self, context: Context, state: State) -> None:
        torque = np.array(self._torque.Eval(context))
        state.get_mutable_discrete_state(self._past).SetFromVector(np.tile(torque, len(self._weights)))

    def _update(self, context: Context, state: State) -> None:
        state.get_mutable_discrete_state(self._past).SetFromVector(self._window(context).ravel())
