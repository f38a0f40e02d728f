"""The numbers of the contact localizer."""

from dataclasses import dataclass

import numpy as np

from saphari_drake.errors import ParameterError
from saphari_drake.parameters import require_non_negative, require_positive
from saphari_drake.perception.segmentation.parameters import SegmentationParameters


@dataclass
class LocalizerParameters(SegmentationParameters):
    """Numbers of the contact localizer."""

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
    # Least share of the robot's visible axis points that must have a reading (0–1) for a frame to be valid.
    least_seen: float = 0.5
    # Time without a frame after which the camera is stale (s, > 0), so that a controller can stop within 0.1 s.
    timeout: float = 0.08
    # Frames in a row that are equal to the one before, bit for bit, from which on the camera is stale: the noise of a
    # camera that works makes no two frames equal. 0: they may be, as without noise.
    frozen_frames: int = 0
    # Deviation of a frame's contact point (m, > 0); it grows by as much as the person is farther away than `near` (m,
    # > 0). How far a contact slides over the robot within a second (m, > 0).
    point_sigma: float = 0.004
    near: float = 0.015
    slide: float = 0.005
    # The same of a contact that is felt too: the residual tells when it slides (m, > 0).
    felt_slide: float = 0.05
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
    # Time over which a frame's residual is averaged (s, ≥ 0), about that between two frames: the noise of encoders is
    # that of a difference, which a sample shows in full and a mean hardly.
    averaged: float = 0.03

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(
            self, "rank", "softness", "spread", "rounds", "gate", "limb_reach", "limb_radius", "limb_gap",
            "limb_distance", "limb_softness", "timeout", "point_sigma", "near", "slide", "felt_slide", "time_constant",
            "jump", "switch_frames", "torque_sigma", "felt", "veto", "memory",
        )  # fmt: skip
        require_non_negative(self, "frozen_frames", "thickness", "least_thickness", "most_thickness", "averaged")
        if self.most_thickness < self.least_thickness:
            raise ParameterError("most_thickness", f"must not be below least_thickness, got {self.most_thickness}")
        if not 0.0 <= self.least_seen <= 1.0:
            raise ParameterError("least_seen", f"must lie in 0–1, got {self.least_seen}")
        if self.gate > self.reach:
            raise ParameterError("gate", f"must not exceed reach ({self.reach} m), got {self.gate}")


@dataclass
class FusionParameters:
    """Numbers of what finds hidden contacts too, see `ContactFusionLaw`."""

    # Points of the surface that are weighed (≥ 10).
    candidates: int = 1700
    # Standard deviation of the residual of each joint (Nm, > 0), and size of a usual force (N, > 0).
    torque_sigma: float = 0.2
    force_scale: float = 30.0
    # Size of a usual force across the normal, over that along it (> 0): what friction lets it lean. A touch of the
    # wrist along its normal makes no torque there, which a force of any direction would hardly do.
    force_across: float = 0.5
    # Friction of skin on the cover, and the share of the largest singular value below which a direction is left out.
    friction: float = 0.5
    rcond: float = 0.02
    # Norm of the residual above which a contact is felt (deviations of one joint, > 0).
    felt: float = 5.0
    # A hidden contact is given if its force leaves no more of the residual than noise and this share (0–1), once the
    # weights of the frames add up to so much (≥ 1), and while the best other place has no more than this probability.
    unexplained: float = 0.1
    least_weight: float = 1.8
    ambiguous: float = 0.25
    # Deviation of a point that the cameras see (m, > 0): of a fine one, its growth with the width of what touches, and
    # that of a fitted limb (m, > 0).
    vision_sigma: float = 0.003
    width_share: float = 0.4
    limb_sigma: float = 0.006
    # Distance of the person up to which a point is taken as it is, and by which more costs 1 (m, > 0).
    near: float = 0.015
    far: float = 0.010
    # Cost of a contact where nobody is seen on the surface although somebody is seen touching it (≥ 0).
    unseen_cost: float = 12.0
    # Cost of a contact in space that is seen to be free (≥ 0), within these distances of the person none to full (m).
    free_cost: float = 16.0
    free_from: float = 0.03
    free_to: float = 0.07
    # Distance from the person's visible parts that costs 1 (m, > 0), and the most that distance costs (≥ 0).
    person_scale: float = 0.06
    person_cost: float = 12.0
    # Deviation of a contact from the axis of the limb that is seen (m, > 0), and its growth with the way ahead of its
    # end (rad, > 0): a wrist bends. It counts instead of the distance where the limb is seen to be long. Assumed.
    ray_sigma: float = 0.012
    ray_bend: float = 0.2
    # Distance between two modes (m, > 0), and number of grid modes that are refined (≥ 2).
    mode_distance: float = 0.05
    modes: int = 3
    # Least probability of a place that is published (0–1).
    least_mode: float = 0.05
    # Weight of a frame's residual when the next one arrives (0–1), and frames that are kept (≥ 1).
    memory: float = 0.9
    # Share of a force that is new with each frame (0–1).
    again: float = 0.2
    frames: int = 8
    # Forces of two contacts: how large they may be (N, > 0), all sizes being equally likely in their logarithm, and how
    # many between are weighed (≥ 2): from what is hardly felt to more than the quasi-static limits of ISO/TS 15066 for
    # a hand. Deviations along and across the normal from a force of that size, over it (> 0): half the way to the next
    # size, and that of a force anywhere in a cone of friction 0.5. The same of a frame's force from the mean of the
    # last frames, over that: people hold a force within some 15 %.
    least_force: float = 1.0
    most_force: float = 200.0
    force_sizes: int = 9
    usual_along: float = 0.3
    usual_across: float = 0.25
    wander_along: float = 0.2
    wander_across: float = 0.15
    # Two contacts are two places where the person is seen, so far apart (m, > 0), at both of which a force of this size
    # (N, ≥ 0) comes out. How much likelier it is that the person touches at both than at one alone (> 0).
    second_distance: float = 0.10
    second_force: float = 1.0
    second_odds: float = 5.0

    def __post_init__(self) -> None:
        require_positive(
            self, "candidates", "torque_sigma", "force_scale", "force_across", "friction", "felt", "vision_sigma",
            "limb_sigma", "near", "far",
            "free_from", "free_to", "person_scale", "ray_sigma", "ray_bend", "mode_distance", "modes", "frames",
            "second_distance", "usual_along", "usual_across", "wander_along", "wander_across",
            "least_force", "force_sizes", "second_odds",
        )  # fmt: skip
        require_non_negative(
            self, "width_share", "unseen_cost", "free_cost", "person_cost", "second_force",
            "unexplained", "least_weight",
        )  # fmt: skip
        for name in ("memory", "again", "ambiguous", "least_mode"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise ParameterError(name, f"must lie in 0–1, got {getattr(self, name)}")
        if not 0.0 < self.rcond < 1.0:
            raise ParameterError("rcond", f"must lie between 0 and 1, got {self.rcond}")
        if not self.least_force < self.most_force < np.inf:
            raise ParameterError("most_force", f"must be finite and above least_force, got {self.most_force}")
        if self.force_sizes < 2:
            raise ParameterError("force_sizes", f"must be at least 2, got {self.force_sizes}")
        if self.free_to <= self.free_from:
            raise ParameterError("free_to", f"must be above free_from ({self.free_from} m), got {self.free_to}")
