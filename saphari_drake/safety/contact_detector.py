"""Contact detection from the size of the residual."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from saphari_drake.errors import ParameterError
from saphari_drake.messages import ContactPoint, status_of
from saphari_drake.parameters import diagonal, require_non_negative, require_positive
from saphari_drake.systems import cycle, declare_cache, declare_readouts

Array = NDArray[np.float64]
MEAN_TIME = 0.5  # s, of the mean about which noise is measured. Assumed


@dataclass
class ContactDetectorParameters:
    """Threshold, hysteresis and noise of the detector."""

    # Nm, one for all joints or one a joint; |r_i| above it is a contact. 1 to 2 in the literature; assumed.
    threshold: list[float] | float = 1.0
    # Nm, standard deviation of the residual without contact, one for all or one a joint; `residual_noise` measures it.
    noise: list[float] | float = 0.0
    # The threshold is at least this many standard deviations of the noise.
    noise_multiple: float = 5.0
    # Nm, one for all joints or one a joint; the residual smoothed over `smoothing_time` (s) above it is a contact too,
    # and above `noise_multiple` deviations of its own, measured over `noise_time` (s). Infinite: none. Assumed.
    smoothed_threshold: list[float] | float = np.inf
    smoothing_time: float = 0.015
    noise_time: float = 2.0
    # Share of the threshold below which every |r_i| must stay for a release.
    release_ratio: float = 0.5
    # s; how long it must stay there.
    release_time: float = 0.05
    # Below the threshold itself, and this share of what it was within `drop_time` (s), it counts as released too: what
    # is left then is friction of the arm's own motion. Assumed.
    drop_share: float = 0.25
    drop_time: float = 0.2
    # s; the control cycle.
    period: float = 0.005

    def __post_init__(self) -> None:
        require_positive(self, "threshold", "noise_multiple", "smoothing_time", "noise_time", "drop_time", "period")
        if not np.all(np.asarray(self.smoothed_threshold, dtype=float) > 0.0):
            raise ParameterError("smoothed_threshold", f"must be positive, got {self.smoothed_threshold}")
        require_non_negative(self, "noise", "release_time", "drop_share")
        if not 0.0 < self.release_ratio < 1.0:
            raise ParameterError("release_ratio", f"must lie between 0 and 1, got {self.release_ratio}")


def residual_noise(residuals: Array) -> Array:
    """Return the standard deviation (n,) of residuals (T, n) recorded with nobody near, for the `noise` parameter."""
    return np.asarray(residuals, dtype=float).std(axis=0)


class ContactDetector(LeafSystem):
    """Says whether the robot is touched.

    .. pydrake_system::

        name: ContactDetector
        input_ports:
        - torque_external
        - torque_uncertainty
        - torque_noise
        - contact_point
        output_ports:
        - ratio
        - system_status
        - contact

    Ports
    -----
    torque_external : n (Nm), the residual r, from `MomentumObserver` or, corrected, from `ModelErrorEstimator`.
    torque_uncertainty : n (Nm), of `ModelErrorEstimator`, by which the threshold is higher; optional, default: zero.
    torque_noise : n (Nm), measured standard deviation of the residual; optional, counts if above the parameter.
    contact_point : abstract `ContactPoint`, of `ContactLocalizer`; optional. While it is seen, the uncertainty does not
        count for a release, but for a drop: somebody is there. No output depends on it.
    contact : 1, 1 while touched, else 0.
    ratio : 1, the largest |r_i| over its threshold, or of the smoothed residual; not finite while an input is not.
    system_status : 1, a `SystemStatus`.

    A weak touch shows late in a residual with the noise of differentiated encoders, whose samples alternate: a short
    average loses most of it (an EWMA chart, Roberts, Technometrics 1959). Its deviation is measured about a slower mean
    while nobody touches.

    Touched as soon as the ratio reaches 1, without delay, and while the residual is not a number; released after it has
    stayed below the release ratio, or dropped, for the release time. The residual's size is the trigger;
    which link it is comes from vision.
    """

    def __init__(self, num_joints: int, params: ContactDetectorParameters | None = None) -> None:
        super().__init__()
        self._params = params = params or ContactDetectorParameters()
        noise = diagonal(params.noise, num_joints, "noise")
        self._threshold = np.maximum(diagonal(params.threshold, num_joints, "threshold"), params.noise_multiple * noise)
        self._torque, self._uncertainty, self._noise = (
            self.DeclareVectorInputPort(name, BasicVector(num_joints))
            for name in ("torque_external", "torque_uncertainty", "torque_noise")
        )
        inputs = {port.ticket() for port in (self._torque, self._uncertainty, self._noise)}
        self._point = self.DeclareAbstractInputPort("contact_point", AbstractValue.Make(ContactPoint()))
        given = np.broadcast_to(np.asarray(params.smoothed_threshold, dtype=float), num_joints)
        self._smoothed_threshold, self._n = given.copy(), num_joints
        times = np.array([params.smoothing_time, MEAN_TIME, params.noise_time])
        self._shares = -np.expm1(-params.period / times)
        # Time left until release (s), 0 when not touched, and the largest ratio of late, which fades; the smoothed
        # residual, its slower mean, and its variance about that.
        calm = (given / params.noise_multiple) ** 2
        start = np.concatenate([np.zeros(2 + 2 * num_joints), np.where(np.isfinite(calm), calm, 0.0)])
        self._remaining = self.DeclareDiscreteState(start)
        self.DeclarePeriodicUnrestrictedUpdateEvent(**cycle(params.period), update=self._update)
        state = self.discrete_state_ticket(self._remaining)
        self._ratio = declare_cache(self, "ratio", 0.0, self._largest, inputs | {state})
        readouts = {"ratio": (1, lambda ratio: [ratio]), "system_status": (1, lambda ratio: [status_of(ratio)])}
        declare_readouts(self, self._ratio, readouts)
        tickets = {self._ratio.ticket(), state}
        touched = declare_cache(self, "touched", False, self._touched, tickets)
        declare_readouts(self, touched, {"contact": (1, lambda touched: [float(touched)])})

    def _largest(self, context: Context) -> float:
        return self._sized(context, self._uncertainty.Eval(context) if self._uncertainty.HasValue(context) else 0.0)

    def _sized(self, context: Context, unsure: Array | float) -> float:
        """Return the ratio for an uncertainty (n,) or 0 (Nm)."""
        threshold, multiple = self._threshold, self._params.noise_multiple
        if self._noise.HasValue(context):
            threshold = np.maximum(threshold, multiple * self._noise.Eval(context))
        r = self._torque.Eval(context)
        smoothed, _, variance = self._calm(context)
        smoothed = smoothed + self._shares[0] * (r - smoothed)
        calm = np.maximum(self._smoothed_threshold, multiple * np.sqrt(variance))
        return float(np.max(np.abs([r / (threshold + unsure), smoothed / (calm + unsure)])))

    def _calm(self, context: Context) -> Array:
        """Return the smoothed residual, its slower mean, and its variance about that (3, n)."""
        return np.array(context.get_discrete_state(self._remaining).value()[2:]).reshape(3, self._n)

    def _touched(self, context: Context) -> bool:
        # Not "ratio >= 1": a residual that is lost (NaN) is no proof that nobody touches.
        return not self._ratio.Eval(context) < 1.0 or context.get_discrete_state(self._remaining).value()[0] > 0.0

    def _update(self, context: Context, state: State) -> None:
        params, ratio = self._params, self._ratio.Eval(context)
        remaining, largest = context.get_discrete_state(self._remaining).value()[:2]
        lasting = self._sized(context, 0.0) if remaining > 0.0 and self._seen(context) else ratio
        released = lasting < params.release_ratio or ratio < min(params.drop_share * largest, 1.0)
        if not ratio < 1.0 or (remaining > 0.0 and not released):
            remaining = max(params.release_time, params.period)
        else:
            remaining = max(0.0, remaining - params.period)
        faded = largest * float(np.exp(-params.period / params.drop_time))
        largest = max(ratio, faded) if np.isfinite(ratio) else faded
        following = np.concatenate([[remaining, largest], self._following(context, remaining > 0.0).ravel()])
        state.get_mutable_discrete_state(self._remaining).SetFromVector(following)

    def _seen(self, context: Context) -> bool:
        """Whether a camera sees who touches; a contact that is hidden has no distance."""
        point = self._point.Eval(context) if self._point.HasValue(context) else ContactPoint()
        return bool(point.found and point.distance != 0.0)

    def _following(self, context: Context, touched: bool) -> Array:
        """Return what `_calm` returns a period later; a residual that is not finite is forgotten."""
        r, (smoothed, mean, variance) = self._torque.Eval(context), self._calm(context)
        if not np.isfinite(r).all():
            return np.array([0.0 * mean, 0.0 * mean, variance])
        smoothed = smoothed + self._shares[0] * (r - smoothed)
        if not touched:
            variance = variance + self._shares[2] * ((smoothed - mean) ** 2 - variance)
            mean = mean + self._shares[1] * (smoothed - mean)
        return np.array([smoothed, mean, variance])
