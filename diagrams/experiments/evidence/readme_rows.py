"""What the README's tables show: which figures in which row, under which label, at which scale."""

from __future__ import annotations

from typing import NamedTuple


class Scale(NamedTuple):
    """How a figure is shown: its factor, the unit after it and the digits that count."""

    factor: float = 1.0
    unit: str = ""
    digits: int = 3


class Row(NamedTuple):
    """A row of the table of experiments; several cases or metrics share it, separated by slashes."""

    script: str
    cases: str
    metrics: str
    label: str
    scale: Scale = Scale()


class Speed(NamedTuple):
    """A row of the table of speed: a benchmark's row, and what it is called."""

    benchmark: str
    row: str
    label: str


PLAIN, PERCENT = Scale(), Scale(100.0, " %")
METRES, MM, MICRONS = Scale(1.0, " m", 4), Scale(1e3, " mm"), Scale(1e6, " µm")
NEWTON, SPEED, RAD = Scale(1.0, " N"), Scale(1.0, " m/s"), Scale(1.0, " rad")
SECONDS, S_AS_MS, MS = Scale(1.0, " s"), Scale(1e3, " ms"), Scale(1.0, " ms")

WORST_PUSH = "error of the contact point, median / p95, worst push"
OBSERVERS = "task_error task_error_pd momentum"

EXPERIMENTS = [
    Row("nmpc_manipulator", "both", "position_error_m", "position error at the goal", MM),
    Row("nmpc_manipulator", "both", "orientation_error_rad", "orientation error at the goal", RAD),
    Row("nmpc_manipulator", "both", "min_distance_m", "least distance, every 1 ms", METRES),
    Row("nmpc_manipulator", "random", "reached_share", "random jobs that reach their goal", PERCENT),
    Row("nmpc_manipulator", "random", "min_distance_margin_m", "least distance in them, beyond the asked one", MM),
    Row("nmpc_mobile_manipulator", "3", "min_clearance_m", "least clearance, every 1 ms", MM),
    Row("nmpc_mobile_manipulator", "1 2 3", "tracking_error_mean_m", "tracking error, mean", MM),
    Row("nmpc_mobile_manipulator", "1 2 3", "step_ms_median", "one step on the simulated plant, median", MS),
    Row("nmpc_mobile_manipulator", "nonholonomic", "lateral_slip", "lateral slip", SPEED),
    Row(
        "nmpc_mobile_manipulator",
        "human",
        "min_clearance_stoppable_m",
        "clearance to a moving arm, told, where stopping keeps it",
        MM,
    ),
    Row(
        "nmpc_mobile_manipulator",
        "human_seen human_random",
        "min_clearance_stoppable_m",
        "the same arm, and that of a random person, seen by a camera alone",
        MM,
    ),
    Row("reverse_priority_planar", "constrained", "max_y4", "largest y at the end of link 4 (hard bound)", METRES),
    Row("reverse_priority_planar", "constrained", "error_goal1_m", "error at the goal out of reach", METRES),
    Row("reverse_priority_planar", "constrained", "error_goal2_m", "error at the other goal", MM),
    Row(
        "reverse_priority_planar",
        "three_level",
        "min_clearance_m",
        "clearance to a moving person, told, every 1 ms",
        MM,
    ),
    Row(
        "reverse_priority_planar",
        "three_level",
        "switch_velocity_share_max",
        "velocity that a constraint adds as it enters or leaves, of what its activation allows",
    ),
    Row("null_space_ball", "none", "dwell_error_m", "task error in the dwell, no observer, against the predicted", MM),
    Row("null_space_ball", OBSERVERS, "dwell_error_m", "task error in the dwell, three observers", MICRONS),
    Row("null_space_ball", OBSERVERS, "transient_error_m", "transient, three observers", MM),
    Row("null_space_wall", "none", "tracking_error_max_m", "largest tracking error, no observer", MM),
    Row("null_space_wall", OBSERVERS, "tracking_error_max_m", "largest tracking error, three observers", MM),
    Row("null_space_ball", "random", "dwell_error_max_m", "task error in the dwell, worst of random pushes", MICRONS),
    Row(
        "skin_hand_guiding",
        "end_effector_first body_first recorded",
        "main_task_disturbance",
        "change of the main task by the second hand",
        PERCENT,
    ),
    Row(
        "skin_hand_guiding",
        "end_effector_first body_first",
        "main_task_disturbance_3x",
        "the same with three times the force",
        PERCENT,
    ),
    Row(
        "skin_hand_guiding",
        "end_effector_first body_first recorded",
        "skin_force_error_relative",
        "error of the skin's force",
        PERCENT,
    ),
    Row(
        "skin_hand_guiding",
        "end_effector_first body_first recorded",
        "skin_point_error_m",
        "error of the skin's point",
        MM,
    ),
    Row("contact_impedance", "natural", "force_error_relative", "error of the estimated force", PERCENT),
    Row("contact_impedance", "natural", "localization_error_m localization_error_p95_m", WORST_PUSH, MM),
    Row("contact_impedance", "natural", "unanswered_share", "part of a push that is not answered, worst push", PERCENT),
    Row("contact_impedance", "natural", "deflection_error_relative", "deflection against F/K_p", PERCENT),
    Row("contact_impedance", "natural", "contact_detection_delay_s", "detection after the first touch", S_AS_MS),
    Row(
        "contact_impedance",
        "modified",
        "return_time_x_s return_time_y_s return_time_z_s",
        "return times X / Y / Z",
        SECONDS,
    ),
    Row("contact_impedance", "modified", "position_error_final_m", "position left after the return", MM),
    Row("contact_impedance", "recorded", "force_error_rms_relative", "error of the force along the recording", PERCENT),
    Row(
        "contact_impedance",
        "recorded",
        "force_error_rms_relative_varying",
        "error of its varying part alone",
        PERCENT,
    ),
    Row("contact_impedance", "recorded", "localization_error_m localization_error_p95_m", WORST_PUSH, MM),
    Row(
        "contact_impedance",
        "random",
        "meets_all_share meets_all_share_seen meets_all_share_hidden",
        "touches that meet every bound: all / seen / hidden",
        PERCENT,
    ),
    Row(
        "contact_impedance",
        "random",
        "force_met_share deflection_met_share point_met_share return_met_share",
        "that meet the bound of force / deflection / point / return",
        PERCENT,
    ),
    Row("contact_impedance", "random", "joint_speed_share_max", "largest joint speed over its limit"),
    Row("contact_impedance", "random", "wander_max_m", "farthest the point wanders after a release", METRES),
    Row("contact_impedance", "random", "trials", "touches"),
    Row("contact_force", "compatible", "force_norm_error_N", "error of the force's size, steady", NEWTON),
    Row(
        "contact_force",
        "compatible",
        "force_norm_error_whole_N",
        "the same with what joint torques do not show",
        NEWTON,
    ),
    Row("contact_force", "drift", "drift_speed_error_relative", "drift speed against the prediction", PERCENT),
    Row("contact_force", "drift", "drift_direction_error_rad", "drift direction against the prediction", RAD),
    Row("contact_force", "drift", "max_speed", "fastest contact point, with the speed stop", SPEED),
    Row("contact_force", "random", "force_norm_error_p95_N", "error of the force, p95 of random touches", NEWTON),
    Row("contact_alone", "links tool blind", "tip_way_m", "farthest the wrist moves, nobody near", MM),
    Row("contact_alone", "links tool blind", "false_contact_share", "time in which a contact is felt", PERCENT),
    Row("identify", "arm tool", "coulomb_error_Nm", "error of the Coulomb friction, worst joint", Scale(1.0, " Nm")),
    Row("identify", "arm tool", "weight_error_before_Nm", "error of the weight as it was", Scale(1.0, " Nm")),
    Row("identify", "arm tool", "weight_error_Nm", "error of the weight that is identified", Scale(1.0, " Nm")),
    Row("contact_localization", "one_camera", "median_m p95_m", "error, median / p95", MM),
    Row("contact_localization", "one_camera", "baseline_median_m baseline_p95_m", "published method, median / p95", MM),
    Row("contact_localization", "two_cameras", "within_20mm", "within 20 mm, all scenes", PERCENT),
    Row("contact_localization", "miscalibrated", "median_m p95_m", "error, median / p95", MM),
    Row(
        "contact_localization",
        "miscalibrated",
        "camera_error_before_median_m camera_error_median_m",
        "error of the camera at the contact, before and after its correction",
        MM,
    ),
    Row("contact_localization", "measured_people", "median_m p95_m", "error, median / p95", MM),
    Row("contact_localization", "measured_people", "finger_median_m finger_p95_m", "fingers, median / p95", MM),
    Row("contact_localization", "measured_people", "finger_taken_for_a_limb", "fingers taken for a limb", PERCENT),
    Row("contact_localization", "hidden", "median_m p95_m", "error, median / p95", MM),
    Row("contact_localization", "hidden", "baseline_median_m baseline_p95_m", "published method, median / p95", MM),
    Row("contact_localization", "hidden", "particle_median_m particle_p95_m", "particle filter, median / p95", MM),
    Row("contact_localization", "two_contacts", "both_found", "contacts found of two at once", PERCENT),
    Row("contact_localization", "two_contacts", "median_of_found_m", "error of those found, median", MM),
    Row("contact_localization", "two_contacts", "force_error_relative_median", "error of their force, median", PERCENT),
    Row("contact_localization", "force_range", "both_found", "contacts found of two at once", PERCENT),
    Row(
        "contact_localization",
        "force_range",
        "force_3_to_10_N_error_relative_median force_10_to_40_N_error_relative_median "
        "force_40_to_80_N_error_relative_median",
        "error of their force, median: 3–10, 10–40, 40–80 N",
        PERCENT,
    ),
    Row("safe_cell", "fixed mobile", "job_time_s", "time of the job beside a person, supervised", SECONDS),
    Row("safe_cell", "fixed mobile", "job_time_ssm_only_s", "the same, keeping its distance alone", SECONDS),
    Row("safe_cell", "fixed mobile", "limit_violations", "samples beyond a limit of torque, speed or position"),
    Row("safe_cell", "fixed mobile", "energy_share_max", "energy of a contact over what its region may have"),
]

NMPC = "benchmark_nmpc"
SPEED_TABLE = [
    *(
        Speed(NMPC, f"case {case}, {mode}", f"predictive control, {what}, {mode.replace('real time', 'one iteration')}")
        for case, what in (("1", "no obstacles"), ("2", "6 obstacles as costs"), ("3", "as constraints as well"))
        for mode in ("real time", "converged")
    ),
    Speed(NMPC, "LeafSystem beyond the solution, case 3", "what the system adds to it"),
    Speed(NMPC, "N_p = 10, 60 obstacle points", "converged, 60 obstacle points"),
    Speed(NMPC, "N_p = 10, 600 obstacle points", "converged, 600 obstacle points"),
    Speed(NMPC, "N_p = 40, 6 obstacle points", "converged, 40 stages"),
    Speed(
        "benchmark_reverse_priority", "reverse priority, 20 constraints", "reverse priority, 3 tasks, 20 constraints"
    ),
    *(
        Speed("benchmark_null_space", f"whole cycle, {observer}, pose", f"null-space compliance, {what}")
        for observer, what in (("none", "no observer"), ("momentum", "momentum observer"))
    ),
    *(
        Speed("benchmark_hand_guiding", name, f"hand guiding, {name}")
        for name in ("nobody touches", "one hand", "two hands")
    ),
    *(
        Speed("benchmark_skin", f"{name}, 2 touches, 0 dead", f"skin, {name}, two touches")
        for name in ("36 modules", "1000 modules")
    ),
    *(
        Speed("benchmark_safety", f"{name}, 7 joints{more}", f"{name}, 7 joints{more}")
        for name, more in (("joint envelope", ""), ("velocity envelope", ""), ("verified stop", ", 16 points"))
    ),
    Speed(
        "benchmark_contact_cycle",
        "all cycles (frames at 30 Hz)",
        "contact cycle of `contact_impedance`, localization included",
    ),
    *(
        Speed("benchmark_localization", f"whole cycle, {count} camera(s)", f"seen and hidden contacts, {text}")
        for count, text in ((1, "one camera"), (2, "two cameras"))
    ),
]
