"""The wrench of a person on a tool, from the reading of the sensor that carries the tool."""

from dataclasses import dataclass, field
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, DiscreteStateIndex, EventStatus, LeafSystem, State

from saphari_drake.errors import ParameterError
from saphari_drake.parameters import require_non_negative, require_positive, require_vector
from saphari_drake.perception.wrench.tool import ToolParameters, sensor_mount, tool_wrench
from saphari_drake.robots.dynamics import DynamicsInput, DynamicsTerms, evaluate_dynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.systems import cycle, declare_cache, declare_readouts

Array = NDArray[np.float64]


class WrenchStatus(IntEnum):
    """What is known of the wrench, also published as a number."""

    OK = 0
    TARING = 1  # the bias is being taken, or the first sample for it awaited: the wrench is told as zero
    BAD_INPUT = 2  # an input is not finite: the wrench is not known, NaN


@dataclass
class WristWrenchParameters:
    """Where the sensor sits, what the wrench refers to, and how the bias is taken."""

    # Joint whose load is measured: a weld at the flange, or the last joint. What it carries is the tool.
    joint: str = "joint_7"
    # Frame of the robot, fixed in the tool, and point in it (m) to which `wrench_measured` refers.
    tip_frame: str = "link_7"
    tip_point: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    # s; control cycle, that of the sensor.
    period: float = 0.002
    # Samples averaged for the bias at the start and after `tare`, ≥ 0; nobody may touch the tool meanwhile. Assumed.
    tare_samples: int = 50

    def __post_init__(self) -> None:
        require_positive(self, "period")
        require_non_negative(self, "tare_samples")
        require_vector(self, 3, "tip_point")


class _Wrench(NamedTuple):
    at_tip: Array  # (6,)
    at_sensor: Array  # (6,)
    status: WrenchStatus


class WristWrenchEstimator(LeafSystem):
    """Takes bias, weight and inertia of the tool out of the reading of a wrist sensor.

    .. pydrake_system::

        name: WristWrenchEstimator
        input_ports:
        - wrench_sensor
        - dynamics
        - acceleration_measured
        output_ports:
        - wrench_measured
        - wrench_tool
        - status

    Ports
    -----
    wrench_sensor : 6 (Nm, N), the reading: moment and force at the sensor, in its own frame S.
    dynamics : abstract `DynamicsTerms`, of the measured state: the posture in which the tool is weighed.
    acceleration_measured : n (rad/s² or m/s²), optional; with it, the tool's inertia is taken out as well.
    wrench_measured : 6 (Nm, N), moment and force of the person on the robot at the tip, world axes.
    wrench_tool : 6 (Nm, N), the same at the sensor, in S.
    status : 1, a `WrenchStatus`.

    The wrench is the reading less the bias and `tool_wrench`. State: the bias, the sum while taring, and how many
    samples that still takes; samples that are not finite do not count.

    Parameters
    ----------
    robot : RobotModel
    params : WristWrenchParameters, optional
    tool : ToolParameters, optional
        Default: as the model has it; of a real tool, as `identify_tool` finds it.

    Raises
    ------
    UnknownNameError
        If there is no such joint or frame.
    ParameterError
        If the tip does not move with the tool.
    """

    def __init__(
        self, robot: RobotModel, params: WristWrenchParameters | None = None, tool: ToolParameters | None = None
    ) -> None:
        super().__init__()
        params = self._params = params or WristWrenchParameters()
        self._link, X_LS, own = sensor_mount(robot, params.joint)
        self.tool = tool or own
        self._R_LS = X_LS.rotation().matrix()
        self._p_LT = np.array(X_LS @ np.asarray(self.tool.com))  # the tool's centre of mass
        tip_link, X_LF = robot.frame(params.tip_frame)
        if tip_link != self._link:
            raise ParameterError("tip_frame", f"'{params.tip_frame}' does not move with {params.joint}")
        self._p_ST = np.array(X_LS.inverse() @ X_LF @ np.asarray(params.tip_point, dtype=float))
        self._g_W = np.array(robot.tree.gravity)
        self._moved_by = [self._link]  # the joints that move it
        while (parent := int(robot.tree.parent[self._moved_by[-1]])) >= 0:
            self._moved_by.append(parent)
        terms = evaluate_dynamics(robot, robot.home, np.zeros(robot.n))
        self._reading = self.DeclareVectorInputPort("wrench_sensor", BasicVector(6))
        self._dynamics = DynamicsInput(self, terms)
        self._acceleration = self.DeclareVectorInputPort("acceleration_measured", BasicVector(robot.n))
        self._bias, self._sum = self.DeclareDiscreteState(6), self.DeclareDiscreteState(6)
        self._left = self.DeclareDiscreteState(np.array([float(params.tare_samples)]))
        tickets = {port.ticket() for port in (self._reading, self._dynamics, self._acceleration)}
        lost = _Wrench(np.full(6, np.nan), np.full(6, np.nan), WrenchStatus.BAD_INPUT)
        entry = declare_cache(self, "wrench", lost, self._evaluate, tickets | {self.xd_ticket()})
        readouts = {
            "wrench_measured": (6, lambda wrench: wrench.at_tip),
            "wrench_tool": (6, lambda wrench: wrench.at_sensor),
            "status": (1, lambda wrench: [float(wrench.status)]),
        }
        declare_readouts(self, entry, readouts)
        self.DeclarePeriodicUnrestrictedUpdateEvent(**cycle(params.period), update=self._take_bias)

    def tare(self, context: Context) -> None:
        """Take the bias anew from the next samples; nobody may touch the tool meanwhile."""
        context.SetDiscreteState(int(self._left), [float(self._params.tare_samples)])
        context.SetDiscreteState(int(self._sum), np.zeros(6))

    def _taken(self, context: Context, index: DiscreteStateIndex) -> Array:
        return np.array(context.get_discrete_state(index).value())

    def _unloaded(self, context: Context) -> tuple[Array, Array]:
        """Return the reading less what the tool puts on the sensor (6,), in S, and S's orientation (3, 3), or NaN."""
        terms: DynamicsTerms = self._dynamics.Eval(context)
        reading, link, rates = self._reading.Eval(context), self._link, None
        vdot = self._acceleration.Eval(context) if self._acceleration.HasValue(context) else None
        if not (terms.finite and np.isfinite(reading).all() and (vdot is None or np.isfinite(vdot).all())):
            return np.full(6, np.nan), np.full((3, 3), np.nan)
        R_WS = terms.R_WL[link] @ self._R_LS
        if vdot is not None:
            point = terms.point(link, self._p_LT)
            alpha = terms.A[link, :3] + terms.S[self._moved_by, :3].T @ vdot[self._moved_by]
            rates = np.array([point.Jv_WC @ vdot + point.Jdotv_WC, alpha, terms.V[link, :3]])
        return reading - tool_wrench(self.tool, R_WS, self._g_W, rates), R_WS

    def _evaluate(self, context: Context) -> _Wrench:
        w, R_WS = self._unloaded(context)
        left = self._taken(context, self._left)[0]
        if not np.isfinite(w).all() and not 0.0 < left == self._params.tare_samples:
            return _Wrench(w, w, WrenchStatus.BAD_INPUT)
        if left > 0.0:
            return _Wrench(np.zeros(6), np.zeros(6), WrenchStatus.TARING)
        w = w - self._taken(context, self._bias)
        at_tip = np.concatenate([R_WS @ (w[:3] - np.cross(self._p_ST, w[3:])), R_WS @ w[3:]])
        return _Wrench(at_tip, w, WrenchStatus.OK)

    def _take_bias(self, context: Context, state: State) -> EventStatus:
        left = self._taken(context, self._left)[0]
        if left == 0.0:
            return EventStatus.DidNothing()
        total = self._taken(context, self._sum) + self._unloaded(context)[0]
        if not np.isfinite(total).all():
            return EventStatus.DidNothing()
        state.get_mutable_discrete_state(self._sum).SetFromVector(total)
        state.get_mutable_discrete_state(self._left).SetFromVector([left - 1.0])
        state.get_mutable_discrete_state(self._bias).SetFromVector(total / self._params.tare_samples)
        return EventStatus.Succeeded()
