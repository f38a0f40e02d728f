"""Wrist force/torque sensor on a plant: what a joint carries, with bias, noise and range."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JointIndex, ModelInstanceIndex
from pydrake.systems.framework import BasicVector, Context, EventStatus, LeafSystem, State

from saphari_drake.errors import UnknownNameError
from saphari_drake.parameters import require_non_negative, require_positive
from saphari_drake.systems import cycle

Array = NDArray[np.float64]


@dataclass
class ForceTorqueSensorParameters:
    """Where the sensor sits, and what disturbs it."""

    # Joint whose load is measured: a weld at the flange, or the last joint. What it carries is the tool.
    joint: str = "joint_7"
    # s; sampling period.
    period: float = 0.001
    # Seed of noise and bias, ≥ 0.
    seed: int = 0
    # N and Nm; noise of each component, that of a six-axis sensor of this size. Assumed.
    noise_force: float = 0.05
    noise_torque: float = 0.001
    # N and Nm; largest bias of each component, drawn once. Assumed.
    bias_force: float = 2.0
    bias_torque: float = 0.05
    # N and Nm; range of each component. Assumed.
    range_force: float = 290.0
    range_torque: float = 10.0

    def __post_init__(self) -> None:
        require_positive(self, "period", "range_force", "range_torque")
        require_non_negative(self, "seed", "noise_force", "noise_torque", "bias_force", "bias_torque")


class ForceTorqueSensor(LeafSystem):
    """Reads the load of a joint: −F, the opposite of the joint's force on its child, with bias and noise.

    .. pydrake_system::

        name: ForceTorqueSensor
        input_ports:
        - reaction_forces
        output_ports:
        - wrench_sensor
        - overload

    Ports
    -----
    reaction_forces : abstract list of `SpatialForce`, from the plant.
    wrench_sensor : 6 (Nm, N), moment and force of tool and person on the sensor, in its own frame S: the joint's frame
        on its child. NaN before the plant's first step.
    overload : 1, one if a component is at the end of its range, so that the reading is a lower bound.

    State: the held reading, and the number of samples, from which the noise follows with the seed.

    Parameters
    ----------
    plant, instance : MultibodyPlant, ModelInstanceIndex
        Where the robot is simulated.
    params : ForceTorqueSensorParameters, optional

    Raises
    ------
    UnknownNameError
        If there is no such joint.
    """

    def __init__(
        self, plant: MultibodyPlant, instance: ModelInstanceIndex, params: ForceTorqueSensorParameters | None = None
    ) -> None:
        super().__init__()
        params = self._params = params or ForceTorqueSensorParameters()
        if not plant.HasJointNamed(params.joint, instance):
            names = [plant.get_joint(JointIndex(i)).name() for i in plant.GetJointIndices(instance)]
            raise UnknownNameError("joint", params.joint, names)
        self._index = int(plant.GetJointByName(params.joint, instance).index())
        spread = np.repeat([params.bias_torque, params.bias_force], 3)
        self._bias = spread * np.random.default_rng([params.seed, 6]).uniform(-1.0, 1.0, 6)
        self._noise = np.repeat([params.noise_torque, params.noise_force], 3)
        self._range = np.repeat([params.range_torque, params.range_force], 3)
        self._reactions = self.DeclareAbstractInputPort("reaction_forces", AbstractValue.Make([SpatialForce.Zero()]))
        self._reading, self._samples = self.DeclareDiscreteState(np.full(6, np.nan)), self.DeclareDiscreteState(1)
        self.DeclareStateOutputPort("wrench_sensor", self._reading)
        held = {self.discrete_state_ticket(self._reading)}
        self.DeclareVectorOutputPort("overload", BasicVector(1), self._calc_overload, prerequisites_of_calc=held)
        self.DeclareInitializationUnrestrictedUpdateEvent(self._sample)
        self.DeclarePeriodicUnrestrictedUpdateEvent(**cycle(params.period), update=self._sample)

    def _calc_overload(self, context: Context, output: BasicVector) -> None:
        reading = context.get_discrete_state(self._reading).value()
        output.SetFromVector([float(np.any(np.abs(reading) >= self._range))])

    def _sample(self, context: Context, state: State) -> EventStatus:
        forces: Sequence[SpatialForce] = self._reactions.Eval(context)
        exact = -forces[self._index].get_coeffs()
        if not np.any(exact):  # the plant has not taken a step
            return EventStatus.DidNothing()
        samples = context.get_discrete_state(self._samples).value()[0]
        rng = np.random.Generator(np.random.SFC64([self._params.seed, int(samples)]))
        reading = exact + self._bias + self._noise * rng.standard_normal(6)
        state.get_mutable_discrete_state(self._reading).SetFromVector(np.clip(reading, -self._range, self._range))
        state.get_mutable_discrete_state(self._samples).SetFromVector([samples + 1.0])
        return EventStatus.Succeeded()
