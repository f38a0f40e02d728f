"""Torque sensors in the joints."""

import numpy as np
from pydrake.systems.framework import BasicVector, Context, LeafSystem

STEP = 0.001  # s; how often the noise is new


class JointTorqueSensor(LeafSystem):
    """Measures what the drives give, with noise; brakes and friction behind it are not felt.

    .. pydrake_system::

        name: JointTorqueSensor
        input_ports:
        - torque
        output_ports:
        - torque_measured

    Ports
    -----
    torque : n (Nm or N), of the drives.
    torque_measured : n (Nm or N), with noise of deviation `noise` (assumed) that follows from seed and time.
    """

    def __init__(self, n: int, seed: int, noise: float = 0.05) -> None:
        super().__init__()
        self._seed, self._noise = seed, noise
        self._torque = self.DeclareVectorInputPort("torque", BasicVector(n))
        tickets = {self._torque.ticket(), self.time_ticket()}
        self.DeclareVectorOutputPort("torque_measured", BasicVector(n), self._calc, prerequisites_of_calc=tickets)

    def _calc(self, context: Context, output: BasicVector) -> None:
        torque = self._torque.Eval(context)
        rng = np.random.Generator(np.random.SFC64([self._seed, 15, round(context.get_time() / STEP)]))
        output.SetFromVector(torque + self._noise * rng.standard_normal(len(torque)))
