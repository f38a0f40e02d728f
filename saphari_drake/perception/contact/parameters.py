"""The numbers of the contact localizer."""

from dataclasses import dataclass

from saphari_drake.errors import ParameterError
from saphari_drake.parameters import require_non_negative, require_positive


@dataclass
class LocalizerParameters:
    """Numbers of the contact localizer. Distances marked (s) hold at `scale_depth` and grow with the depth squared."""

    # Distance around the robot within which the image is examined (m, > 0).
    reach: float = 0.12
    # Distance from the robot beyond which a reading surely is no robot (m, s, > grow_distance).
    seed_distance: float = 0.020
    # Distance beyond which a reading within 4 pixels of such a one is none either (m, s, > 0).
    grow_distance: float = 0.008
    # Margin before the background within which a reading counts as background (m, s, > 0).
    background_margin: float = 0.020
    # Depth at which (s) holds (m, > 0), and the least factor by which a smaller depth shrinks it (0–1).
    scale_depth: float = 1.7
    least_scale: float = 0.25
    # Least number of the person's pixels in a 5 × 5 window (1–25) at depths that differ by less than this (m, s, > 0).
    support: int = 7
    support_step: float = 0.03
    # Least number of the person's pixels in a connected component (≥ 1).
    component: int = 25
    # Rank of the smallest distance that anchors the soft minimum (≥ 1), its width (m, > 0), its extent (m, > 0), and
    # how often it is centred anew (≥ 1).
    rank: int = 6
    softness: float = 0.005
    spread: float = 0.05
    rounds: int = 3
    # The camera sees the near side of what touches; its middle lies behind by this share (≥ 0) of the deviation of its
    # points across the view, at least and at most so far (m): what touches is about as thick as it is wide.
    thickness: float = 1.5
    least_thickness: float = 0.0065
    most_thickness: float = 0.019
    # A limb is fitted to the readings within this distance of their nearest place (m, > 0). It counts if its radius is
    # no smaller than this (m, > 0) and it touches the robot within two deviations of this (m, > 0), and is tried if the
    # nearest reading is no farther than this (m, > 0). Softness of a limb (m, > 0).
    limb_reach: float = 0.12
    limb_radius: float = 0.020
    limb_gap: float = 0.010
    limb_distance: float = 0.08
    limb_softness: float = 0.003
    # Distance of the person below which a contact is possible (m, > 0).
    gate: float = 0.028
    # Spacing of the person's points that are published (pixels, ≥ 1).
    points_stride: int = 6
    # Least share of the robot's visible axis points that must have a reading (0–1) for a frame to be valid.
    least_seen: float = 0.5
    # Time without a frame after which the camera is stale (s, > 0), so that a controller can stop within 0.1 s.
    timeout: float = 0.08
    # Deviation of a frame's contact point (m, > 0); it grows by as much as the person is farther away than `near` (m,
    # > 0). How far a contact slides over the robot within a second (m, > 0).
    point_sigma: float = 0.004
    near: float = 0.015
    slide: float = 0.005
    # Time constant with which what speaks for a limb, or for another link, is smoothed over frames (s, > 0).
    time_constant: float = 0.15
    # Distance from the smoothed point beyond which a point is another place (m, > 0).
    jump: float = 0.04
    # Frames in a row that must show a place beyond that before it is taken while in contact (≥ 1).
    switch_frames: int = 2
    # Standard deviation of the residual of each joint (Nm, > 0), the norm of the residual from which on it is asked,
    # and the norm of its unexplained part from which on it vetoes a contact point (deviations, > 0).
    torque_sigma: float = 0.1
    felt: float = 10.0
    veto: float = 3.0
    # Time over which postures are remembered (s, > 0); a frame that is older when it arrives is not used.
    memory: float = 0.3

    def __post_init__(self) -> None:
        require_positive(
            self, "reach", "seed_distance", "grow_distance", "background_margin", "scale_depth", "least_scale",
            "support", "support_step", "component", "rank", "softness", "spread", "rounds", "gate",
            "limb_reach", "limb_radius", "limb_gap", "limb_distance", "limb_softness", "points_stride",
            "timeout", "point_sigma", "near", "slide", "time_constant", "jump", "switch_frames", "torque_sigma",
            "felt", "veto", "memory",
        )  # fmt: skip
        require_non_negative(self, "thickness", "least_thickness", "most_thickness")
        if self.most_thickness < self.least_thickness:
            raise ParameterError("most_thickness", f"must not be below least_thickness, got {self.most_thickness}")
        if self.grow_distance >= self.seed_distance:
            raise ParameterError("grow_distance", f"must be below seed_distance, got {self.grow_distance}")
        if self.least_scale > 1.0:
            raise ParameterError("least_scale", f"must not exceed 1, got {self.least_scale}")
        if self.support > 25:
            raise ParameterError("support", f"a window has 25 pixels, got {self.support}")
        if not 0.0 <= self.least_seen <= 1.0:
            raise ParameterError("least_seen", f"must lie in 0–1, got {self.least_seen}")
        if self.gate > self.reach:
            raise ParameterError("gate", f"must not exceed reach ({self.reach} m), got {self.gate}")
