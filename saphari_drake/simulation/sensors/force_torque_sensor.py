"""Wrist force/torque sensor: what a joint carries, without the tool's own weight."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Joint, JointIndex, ModelInstanceIndex
from pydrake.systems.framework import BasicVector, Context, EventStatus, LeafSystem, State

from saphari_drake.errors import ParameterError, UnknownNameError
from saphari_drake.parameters import require_non_negative, require_positive
from saphari_drake.perception.wrench.tool import ToolParameters, tool_of_plant, tool_wrench
from saphari_drake.robots.dynamics import DynamicsTerms, evaluate_dynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.systems import cycle, declare_cache, declare_readouts

Array = NDArray[np.float64]


@dataclass
class ForceTorqueSensorParameters:
    """Where the sensor sits, and what disturbs it."""

    # Joint whose load is measured: a weld at the flange, or the last joint. What it carries is the tool.
    joint: str = "joint_7"
    # Frame of the robot, fixed in the tool, and point in it (m) to which `wrench_measured` refers.
    tip_frame: str = "link_7"
    tip_point: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    # s; sampling period.
    period: float = 0.001
    # Seed of noise and bias, ≥ 0.
    seed: int = 0
    # N and Nm; noise of each component, that of a six-axis sensor of this size. A.
    noise_force: float = 0.05
    noise_torque: float = 0.001
    # N and Nm; largest bias of each component, drawn once. A.
    bias_force: float = 2.0
    bias_torque: float = 0.05
    # N and Nm; range of each component. A.
    range_force: float = 290.0
    range_torque: float = 10.0
    # Samples averaged for the bias at the start and after `tare`, ≥ 0; nobody may touch the tool meanwhile. A.
    tare_samples: int = 50

    def __post_init__(self) -> None:
        require_positive(self, "period", "range_force", "range_torque")
        require_non_negative(
            self, "seed", "noise_force", "noise_torque", "bias_force", "bias_torque", "tare_samples"
        )  # fmt: skip
        if np.shape(self.tip_point) != (3,) or not np.all(np.isfinite(self.tip_point)):
            raise ParameterError("tip_point", f"needs three finite numbers, got {self.tip_point}")


class _Wrenches(NamedTuple):
    at_tip: Array
    at_sensor: Array
    overload: bool


class ForceTorqueSensor(LeafSystem):
    """Measures the wrench of a person on the tool.

    .. pydrake_system::

        name: ForceTorqueSensor
        input_ports:
        - reaction_forces
        - dynamics
        - acceleration_measured
        output_ports:
        - wrench_measured
        - wrench_sensor
        - overload

    Ports
    -----
    reaction_forces : abstract list of `SpatialForce`, from the plant.
    dynamics : abstract `DynamicsTerms`, of the measured state: the posture in which the tool is weighed.
    acceleration_measured : n (rad/s² or m/s²), optional; with it, the tool's inertia is taken out as well.
    wrench_measured : 6 (Nm, N), moment and force of the person on the robot at the tip, world axes.
    wrench_sensor : 6 (Nm, N), the same at the sensor, in its own frame S: the joint's frame on its child.
    overload : 1, one if a component was at the end of its range, so that the wrench is a lower bound.

    The sensor reads −F, the opposite of the joint's force on its child, with bias and noise; the wrench is the reading
    less the bias and `tool_wrench`. While taring, and before the plant's first step, it is zero. State: the held
    reading, the bias taken, the sum while taring, and the number of samples, from which the noise follows with the
    seed.

    Parameters
    ----------
    robot : RobotModel
    plant, instance : MultibodyPlant, ModelInstanceIndex
        Where the robot is simulated.
    params : ForceTorqueSensorParameters, optional
    tool : ToolParameters, optional
        Default: as the plant has it.

    Raises
    ------
    UnknownNameError
        If there is no such joint or frame.
    ParameterError
        If the tip does not move with the tool.
    """

    def __init__(
        self,
        robot: RobotModel,
        plant: MultibodyPlant,
        instance: ModelInstanceIndex,
        params: ForceTorqueSensorParameters | None = None,
        tool: ToolParameters | None = None,
    ) -> None:
        super().__init__()
        self._robot, self._params = robot, params or ForceTorqueSensorParameters()
        params = self._params
        joint = _joint(plant, instance, params.joint)
        self._index = int(joint.index())
        self.tool = tool or tool_of_plant(plant, joint)
        self._link = robot.link_index(joint.child_body().name())
        link_frame = plant.GetFrameByName(robot.link_names[self._link], instance)
        X_LS = joint.frame_on_child().CalcPose(plant.CreateDefaultContext(), link_frame)
        self._R_LS, self._p_LS = X_LS.rotation().matrix(), np.array(X_LS.translation())
        tip_link, X_LF = robot.frame(params.tip_frame)
        if tip_link != self._link:
            raise ParameterError("tip_frame", f"'{params.tip_frame}' does not move with {joint.child_body().name()}")
        self._p_ST = self._R_LS.T @ (X_LF @ np.asarray(params.tip_point, dtype=float) - self._p_LS)
        self._g_W = np.array(robot.tree.gravity)
        spread = np.repeat([params.bias_torque, params.bias_force], 3)
        self._true_bias = spread * np.random.default_rng([params.seed, 6]).uniform(-1.0, 1.0, 6)
        self._noise = np.repeat([params.noise_torque, params.noise_force], 3)
        self._range = np.repeat([params.range_torque, params.range_force], 3)
        self._declare()

    def _declare(self) -> None:
        n = self._robot.n
        terms = evaluate_dynamics(self._robot, self._robot.home, np.zeros(n))
        self._reactions = self.DeclareAbstractInputPort("reaction_forces", AbstractValue.Make([SpatialForce.Zero()]))
        self._dynamics = self.DeclareAbstractInputPort("dynamics", AbstractValue.Make(terms))
        self._acceleration = self.DeclareVectorInputPort("acceleration_measured", BasicVector(n))
        self._reading, self._bias = self.DeclareDiscreteState(6), self.DeclareDiscreteState(6)
        self._sum = self.DeclareDiscreteState(6)
        # Samples taken, and those still to be taken for the bias.
        self._counts = self.DeclareDiscreteState(np.array([0.0, float(self._params.tare_samples)]))
        zero = _Wrenches(np.zeros(6), np.zeros(6), False)
        tickets = {self._dynamics.ticket(), self._acceleration.ticket(), self.xd_ticket()}
        self._wrenches = declare_cache(self, "wrenches", zero, self._evaluate, tickets)
        readouts = {
            "wrench_measured": (6, lambda w: w.at_tip),
            "wrench_sensor": (6, lambda w: w.at_sensor),
            "overload": (1, lambda w: [float(w.overload)]),
        }
        declare_readouts(self, self._wrenches, readouts)
        self.DeclareInitializationUnrestrictedUpdateEvent(self._sample)
        self.DeclarePeriodicUnrestrictedUpdateEvent(**cycle(self._params.period), update=self._sample)

    def tare(self, context: Context) -> None:
        """Take the bias anew from the next samples; nobody may touch the tool meanwhile."""
        samples = self._get(context, self._counts)[0]
        context.SetDiscreteState(int(self._counts), [samples, float(self._params.tare_samples)])
        context.SetDiscreteState(int(self._sum), np.zeros(6))

    @staticmethod
    def _get(context: Context, index) -> Array:
        return np.array(context.get_discrete_state(index).value())

    def _tool_wrench(self, context: Context) -> tuple[Array, Array]:
        terms: DynamicsTerms = self._dynamics.Eval(context)
        link = self._link
        R_WS = terms.R_WL[link] @ self._R_LS
        if not self._acceleration.HasValue(context):
            return tool_wrench(self.tool, R_WS, self._g_W), R_WS
        vdot = self._acceleration.Eval(context)
        p_LC = self._p_LS + self._R_LS @ np.asarray(self.tool.com)
        point = terms.point(link, p_LC)
        alpha = terms.A[link, :3].copy()
        while link >= 0:
            alpha += terms.S[link, :3] * vdot[link]
            link = terms.parent[link]
        rates = np.array([point.Jv_WC @ vdot + point.Jdotv_WC, alpha, terms.V[self._link, :3]])
        return tool_wrench(self.tool, R_WS, self._g_W, rates), R_WS

    def _evaluate(self, context: Context) -> _Wrenches:
        counts = self._get(context, self._counts)
        if counts[0] == 0.0 or counts[1] > 0.0:
            return _Wrenches(np.zeros(6), np.zeros(6), False)
        reading = self._get(context, self._reading)
        own, R_WS = self._tool_wrench(context)
        w = reading - self._get(context, self._bias) - own
        at_tip = np.concatenate([R_WS @ (w[:3] - np.cross(self._p_ST, w[3:])), R_WS @ w[3:]])
        return _Wrenches(at_tip, w, bool(np.any(np.abs(reading) >= self._range)))

    def _sample(self, context: Context, state: State) -> EventStatus:
        forces: Sequence[SpatialForce] = self._reactions.Eval(context)
        exact = -forces[self._index].get_coeffs()
        if not np.any(exact):  # the plant has not taken a step
            return EventStatus.DidNothing()
        samples, left = self._get(context, self._counts)
        rng = np.random.Generator(np.random.SFC64([self._params.seed, int(samples)]))
        reading = exact + self._true_bias + self._noise * rng.standard_normal(6)
        reading = np.clip(reading, -self._range, self._range)
        if left > 0.0:
            total = self._get(context, self._sum) + reading - self._tool_wrench(context)[0]
            state.get_mutable_discrete_state(self._sum).SetFromVector(total)
            left -= 1.0
            if left == 0.0:
                mean = total / self._params.tare_samples
                state.get_mutable_discrete_state(self._bias).SetFromVector(mean)
        state.get_mutable_discrete_state(self._reading).SetFromVector(reading)
        state.get_mutable_discrete_state(self._counts).SetFromVector([samples + 1.0, left])
        return EventStatus.Succeeded()


def _joint(plant: MultibodyPlant, instance: ModelInstanceIndex, name: str) -> Joint:
    if not plant.HasJointNamed(name, instance):
        names = [plant.get_joint(JointIndex(i)).name() for i in plant.GetJointIndices(instance)]
        raise UnknownNameError("joint", name, names)
    return plant.GetJointByName(name, instance)
