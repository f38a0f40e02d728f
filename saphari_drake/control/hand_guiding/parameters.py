"""Parameters of hand guiding."""

from dataclasses import dataclass, field

from saphari_drake.errors import ParameterError
from saphari_drake.parameters import (
    positive_definite,
    require_choice,
    require_non_negative,
    require_positive,
    require_vector,
)

FEEDBACK = ("measured", "commanded")


@dataclass
class GuidedPointParameters:
    """How one point answers the hand, and how far it may be led. All assumed."""

    # kg and Ns/m; M_c and D_c of (48): one value, a diagonal in the world's axes, or a matrix.
    mass: list[float] = field(default_factory=lambda: [5.0, 5.0, 5.0])
    damping: list[float] = field(default_factory=lambda: [30.0, 30.0, 30.0])
    # N; a touch begins above `touch_on` and ends below `touch_off`.
    touch_on: float = 3.0
    touch_off: float = 1.5
    # m/s; largest speed that a hand can lead the point with.
    max_speed: float = 0.4
    # m; the point is not led farther than this from where it is in the posture at the start. 0: no bound.
    workspace_radius: float = 0.5

    def __post_init__(self) -> None:
        positive_definite(self.mass, 3, "mass")
        positive_definite(self.damping, 3, "damping")
        require_positive(self, "touch_on", "touch_off", "max_speed")
        require_non_negative(self, "workspace_radius")
        if self.touch_off >= self.touch_on:
            raise ParameterError("touch_off", f"must be below touch_on, {self.touch_on}, got {self.touch_off}")


@dataclass
class HandGuidingParameters:
    """Gains, thresholds and limits; A unless marked."""

    # Guided point of the end effector: a frame of the robot (empty: the last link) and a point in it (m).
    tip_frame: str = ""
    tip_point: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    end_effector: GuidedPointParameters = field(default_factory=GuidedPointParameters)
    # The body is nearer to the shoulder: the same speed there means faster joints, and three to seven times that speed
    # at the end effector. Heavier, with the same time constant.
    body: GuidedPointParameters = field(
        default_factory=lambda: GuidedPointParameters([15.0] * 3, [90.0] * 3, max_speed=0.08)
    )
    # 1/s², 1/s; k_p and k_d of (50).
    k_p: float = 100.0
    k_d: float = 20.0
    # 1/s², 1/s; K_P and K_D of (47).
    K_P: float = 400.0
    K_D: float = 40.0
    # Whether (47) carries the Coriolis term that the deliverable leaves out.
    coriolis: bool = True
    # Which motion (49) and (50) take for the actual one: measured, as published, or commanded, for a stiff arm that is
    # sent positions.
    feedback: str = "measured"
    # m/rad (m/m); singular values of a point's Jacobian below this are damped.
    damping_threshold: float = 0.05
    # 1/s; rates at which joint motion that no point asks for fades, all motion after a release, and after a fault.
    null_damping: float = 6.0
    hold_damping: float = 6.0
    fault_damping: float = 20.0
    # s; how long a force must stay below `touch_off` for the touch to end.
    release_time: float = 0.2
    # s; time over which a change of the law fades in.
    fade_time: float = 0.06
    # s; smoothing of the forces' torque that (47) feeds forward (0: none): their noise shakes a light wrist, a lag
    # lowers the stiffness of hands that it is stable with.
    force_time: float = 0.0
    # s; smoothing of the contact point on the skin.
    point_time: float = 0.1
    # s; a reading of the skin older than this counts as lost.
    timeout: float = 0.05
    # s; the workspace's and the joints' limits are approached with this time constant.
    approach_time: float = 0.2
    # Share of its reach from the shoulder to which the end effector is led (≤ 1): there the arm is not yet stretched,
    # whatever its elbow and wrist do, and what a second hand does to these stays without effect.
    reach_share: float = 0.99
    # m/s²; with which a point that leaves its workspace, or comes too fast to its border, is slowed down at most. A
    # point that is led there needs its speed over the approach time.
    point_deceleration: float = 5.0
    # rad (m); distance kept from the joints' limits, and share of their velocity limits that is used.
    joint_margin: float = 0.03
    joint_speed_share: float = 0.9
    # rad/s² (m/s²); largest commanded acceleration of a joint.
    max_acceleration: float = 20.0
    # rad/s² (m/s²); deceleration with which a joint can always be stopped before its limit.
    max_deceleration: float = 30.0
    # rad (m); the command leads a measured joint by no more than this, with feedback = measured.
    max_lag: float = 0.1
    # Share of the force on a point that may be without effect before the status says so.
    partial_share: float = 0.2
    # N/m and Ns/m; the hand at the end effector that is expected. Stiffness 0: not stated; otherwise there is a warning
    # if these gains can oscillate with it.
    hand_stiffness: float = 0.0
    hand_damping: float = 0.0
    # s; the control cycle.
    period: float = 0.002

    def __post_init__(self) -> None:
        require_positive(
            self, "k_p", "k_d", "K_P", "K_D", "damping_threshold", "null_damping", "hold_damping", "fault_damping",
            "fade_time", "point_time", "point_deceleration", "timeout", "approach_time", "joint_speed_share", "max_lag",
            "max_acceleration", "max_deceleration", "release_time", "reach_share", "period",
        )  # fmt: skip
        require_non_negative(self, "force_time", "joint_margin", "partial_share", "hand_stiffness", "hand_damping")
        require_choice(self, "feedback", FEEDBACK)
        require_vector(self, 3, "tip_point")
        for name in ("joint_speed_share", "reach_share"):
            if getattr(self, name) > 1.0:
                raise ParameterError(name, f"must not exceed 1, got {getattr(self, name)}")
        if self.approach_time < 2.0 * self.period:
            raise ParameterError("approach_time", f"must be at least two periods, {2.0 * self.period} s")
        rate = max(self.null_damping, self.hold_damping, self.fault_damping, self.k_d, self.K_D)
        if rate * self.period > 0.5:
            raise ParameterError("period", f"must not exceed {0.5 / rate:.3g} s, half the fastest time constant")
