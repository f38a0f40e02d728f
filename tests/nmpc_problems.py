"""The benchmark problem of the predictive control: a mobile manipulator passing six obstacles, with all its numbers."""

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

from saphari_drake.control.nmpc.data import no_multipliers
from saphari_drake.control.nmpc.horizon import evaluate
from saphari_drake.control.nmpc.parameters import NmpcParameters, NmpcReference, TestPoint
from saphari_drake.control.nmpc.problem import NmpcProblem
from saphari_drake.messages import ObstaclePoints
from saphari_drake.robots import catalog

DH_D = [0.3105, 0.0, 0.4, 0.0, 0.39, 0.0, 0.078]
DH_ALPHA = np.deg2rad([90, -90, -90, 90, 90, -90, 0])
MOUNT = np.array([0.25, 0.0, 0.70])
HOME = np.concatenate([np.zeros(3), np.deg2rad([0.0, -30.0, 0.0, 83.7, 0.0, 23.7, 0.0])])
SCALE = [1.0] * 3 + [0.5] * 7
# Name, link (0: platform, i: after DH joint i), offset, d_min, c.
POINTS = [
    ("platform_front", 0, [0.3, 0, 0.35], 0.6, 5e-4),
    ("platform_rear", 0, [-0.3, 0, 0.35], 0.6, 5e-4),
    ("shoulder", 1, [0, 0, 0], 0.2, 1e-4),
    ("upper_arm", 2, [0, 0, 0.2], 0.2, 1e-4),
    ("elbow", 3, [0, 0, 0], 0.2, 1e-4),
    ("forearm_1", 4, [0, 0, 0.13], 0.2, 1e-4),
    ("forearm_2", 4, [0, 0, 0.26], 0.2, 1e-4),
    ("wrist", 5, [0, 0, 0], 0.2, 1e-4),
    ("hand", 6, [0, 0, 0.04], 0.2, 1e-4),
    ("flange", 7, [0, 0, 0], 0.2, 1e-4),
]
OBSTACLES = np.array(
    [
        [-0.36, 2.55, 0.20],
        [1.00, 3.15, 0.25],
        [0.14, 2.70, 1.27],
        [-0.24, 2.95, 1.10],
        [0.05, 3.10, 0.95],
        [-0.05, 2.80, 1.52],
    ]
)
# Whether obstacles are in the objective, and in the constraints.
CASES = {"1": (False, False), "2": (True, False), "3": (True, True), "3h": (False, True)}
STEPS, PERIOD = 300, 0.1
SPEED, Y_END, HEIGHT = 0.2, 6.0, 1.2


def dh_frames(q):
    """Return the platform's frame and the frames after each DH joint, in the world, as 4×4 matrices."""
    X = RigidTransform(RotationMatrix.MakeZRotation(q[2]), [q[0], q[1], 0.0])
    frames = [X.GetAsMatrix4()]
    X = X @ RigidTransform(MOUNT)
    for angle, d, alpha in zip(q[3:], DH_D, DH_ALPHA):
        X = X @ RigidTransform(RotationMatrix.MakeZRotation(angle), [0, 0, 0])
        X = X @ RigidTransform(RotationMatrix.MakeXRotation(alpha), [0, 0, d])
        frames.append(X.GetAsMatrix4())
    return frames


def link_frames(robot, q):
    """Return the poses of the robot's links in the world as 4×4 matrices."""
    R, p, *_ = robot.kinematics(q).motion
    return [np.vstack([np.hstack([a, b[:, None]]), [0, 0, 0, 1]]) for a, b in zip(R, p)]


def dh_in_links(robot):
    """Return the constant poses of the DH frames in the links that carry them, checked at another posture."""
    found = []
    for seed in (0, 1):
        q = np.random.default_rng(seed).uniform(-1.0, 1.0, 10)
        found.append([np.linalg.inv(L) @ D for L, D in zip(link_frames(robot, q)[2:], dh_frames(q))])
    np.testing.assert_allclose(found[0], found[1], atol=1e-12)
    return found[0]


def benchmark_problem(case="3", **changes):
    """Return the benchmark's problem of one case; `changes` replaces parameters."""
    robot = catalog.omnirob()
    X_LD = dh_in_links(robot)
    points = [
        TestPoint(name, robot.link_names[2 + link], (X_LD[link] @ [*offset, 1.0])[:3].tolist(), d_min, c)
        for name, link, offset, d_min, c in POINTS
    ]
    cost, rows = CASES[case]
    values = {
        "Q_v": [0.2] * 3 + [0.05] * 7,
        "Q_q": [0.0] * 3 + [0.02] * 7,
        "R_q": [0.0] * 3 + [0.1] * 7,
        "obstacle_cost": cost,
        "obstacle_constraints": rows,
        "between_samples": False,
        "velocity_scale": SCALE,
        "home": HOME.tolist(),
    }
    X_LE = RigidTransform(X_LD[7])
    return NmpcProblem(robot, robot.link_names[-1], points, NmpcParameters(**(values | changes)), X_LE)


def test_points(problem, q):
    """Return the test points (points, 3) in the world at joint positions `q`."""
    R, p = problem.end_effector_pose(q)
    scene = problem.scene(q, NmpcReference(p[None], R[None]), ObstaclePoints())
    Q = np.tile(q, (problem.N, 1))
    return evaluate(problem.data, scene, Q, no_multipliers(scene, *Q.shape), False, False).P[0]


test_points.__test__ = False


def start(problem):
    """Return the start positions, heading along y with the end effector at the reference's start, and R_ref."""
    q = HOME.copy()
    q[2] = np.pi / 2
    R, p = problem.end_effector_pose(q)
    q[1] = -p[1]
    return q, R


def reference(R_ref, t, rows):
    """Return the reference of the next `rows` stages from time `t` (s)."""
    y = np.minimum(SPEED * (t + PERIOD * np.arange(rows)), Y_END)
    return NmpcReference(
        np.column_stack([np.zeros(rows), y, np.full(rows, HEIGHT)]), np.broadcast_to(R_ref, (rows, 3, 3)).copy()
    )


def obstacles(points=OBSTACLES):
    """Return resting obstacle points without extent."""
    return ObstaclePoints(np.array(points, dtype=float), np.zeros((len(points), 3)), np.zeros(len(points)), 0.0)
