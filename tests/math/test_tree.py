"""The compiled tree dynamics equal those of two independent engines, on fixed, branched, prismatic and mobile arms."""

import numpy as np
import pytest
from arms import ARMS, PinocchioTwin, states
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable, MultibodyForces

from saphari_drake.robots.dynamics import evaluate_dynamics

STATES = 100


@pytest.fixture(params=ARMS)
def robot(request, load_arm):
    return load_arm(request.param)


def assert_agree(actual, expected, tolerance=1e-9):
    np.testing.assert_allclose(actual, expected, rtol=tolerance, atol=tolerance)


@pytest.fixture
def plant(robot):
    plant = MultibodyPlant(0.0)
    robot.add_to(plant)
    plant.Finalize()
    return plant


def test_dynamics_equal_drakes(robot, plant):
    """M, Cq̇, g and p = Mq̇ of MultibodyPlant."""
    context = plant.CreateDefaultContext()
    for q, v in states(robot, STATES):
        plant.SetPositions(context, q)
        plant.SetVelocities(context, v)
        terms = evaluate_dynamics(robot, q, v)
        M = plant.CalcMassMatrix(context)
        assert_agree(terms.M, M)
        assert_agree(terms.Cv, plant.CalcBiasTerm(context))
        assert_agree(terms.g, -plant.CalcGravityGeneralizedForces(context))
        assert_agree(terms.p, M @ v)


def test_kinematics_equal_drakes(robot, plant):
    """Poses, Jacobians, velocities and J̇q̇ of random points on every link."""
    context, rng = plant.CreateDefaultContext(), np.random.default_rng(1)
    world, wrt = plant.world_frame(), JacobianWrtVariable.kV
    frames = [plant.GetFrameByName(name) for name in robot.link_names]
    for q, v in states(robot, STATES // 5, seed=1):
        plant.SetPositions(context, q)
        plant.SetVelocities(context, v)
        terms = evaluate_dynamics(robot, q, v)
        for link, frame in enumerate(frames):
            p_LC = rng.uniform(-0.3, 0.3, 3)
            point = terms.point(link, p_LC)
            X_WL = frame.CalcPoseInWorld(context)
            assert_agree(terms.R_WL[link], X_WL.rotation().matrix())
            assert_agree(point.p_WC, X_WL @ p_LC)
            assert_agree(robot.kinematics(q).position(link, p_LC), point.p_WC)
            J = plant.CalcJacobianTranslationalVelocity(context, wrt, frame, p_LC, world, world)
            assert_agree(point.Jv_WC, J)
            assert_agree(point.v_WC, J @ v)
            bias = plant.CalcBiasTranslationalAcceleration(context, wrt, frame, p_LC, world, world)
            assert_agree(point.Jdotv_WC, bias.ravel())


def test_dynamics_equal_pinocchios(robot):
    """M, Cq̇, Cᵀq̇ and g of Pinocchio, which reads the file itself and has a C with Ṁ = C + Cᵀ."""
    twin = PinocchioTwin(robot)
    for q, v in states(robot, STATES, seed=2):
        terms = evaluate_dynamics(robot, q, v)
        for actual, expected in zip((terms.M, terms.Cv, terms.CTv, terms.g), twin.dynamics(q, v), strict=True):
            assert_agree(actual, expected)


def test_kinematics_equal_pinocchios(robot):
    twin, rng = PinocchioTwin(robot), np.random.default_rng(3)
    for q, v in states(robot, STATES, seed=3):
        link, p_LC = int(rng.integers(robot.n)), rng.uniform(-0.3, 0.3, 3)
        actual = evaluate_dynamics(robot, q, v).point(link, p_LC)
        for one, other in zip(actual, twin.point(q, v, link, p_LC), strict=True):
            assert_agree(one, other)


def test_inertia_matrix_rate_is_c_plus_its_transpose(robot):
    """Ṁq̇ = Cq̇ + Cᵀq̇, Ṁ by central differences along the motion."""
    h = 1e-5
    for q, v in states(robot, 20, seed=4):
        terms = evaluate_dynamics(robot, q, v)
        M_dot = (evaluate_dynamics(robot, q + h * v, v).M - evaluate_dynamics(robot, q - h * v, v).M) / (2 * h)
        assert_agree(terms.Cv + terms.CTv, M_dot @ v, 1e-7)


def test_transposed_coriolis_term_is_the_gradient_of_kinetic_energy(robot):
    """Cᵀq̇ = ∂T/∂q at constant q̇."""
    h = 1e-5
    for q, v in states(robot, 10, seed=5):
        energy = [
            [0.5 * v @ evaluate_dynamics(robot, q + s * h * e, v).M @ v for s in (1, -1)] for e in np.eye(robot.n)
        ]
        gradient = (np.array(energy)[:, 0] - np.array(energy)[:, 1]) / (2 * h)
        assert_agree(evaluate_dynamics(robot, q, v).CTv, gradient, 1e-6)


def test_jacobian_and_its_rate_are_derivatives(robot):
    """J = ∂p/∂q and J̇q̇ = d(Jq̇)/dt at constant q̇, by central differences."""
    h, link, p_LC = 1e-5, robot.n - 1, np.array([0.05, -0.1, 0.2])
    for q, v in states(robot, 10, seed=6):
        point = evaluate_dynamics(robot, q, v).point(link, p_LC)
        columns = [
            np.subtract(*(robot.kinematics(q + s * h * e).position(link, p_LC) for s in (1, -1))) / (2 * h)
            for e in np.eye(robot.n)
        ]
        assert_agree(point.Jv_WC, np.array(columns).T, 1e-7)
        ahead, behind = (evaluate_dynamics(robot, q + s * h * v, v).point(link, p_LC).v_WC for s in (1, -1))
        assert_agree(point.Jdotv_WC, (ahead - behind) / (2 * h), 1e-7)


def test_inverse_dynamics_equal_drakes(robot, plant):
    """τ = Mq̈ + Cq̇ + g is Drake's inverse dynamics."""
    context, rng = plant.CreateDefaultContext(), np.random.default_rng(7)
    for q, v in states(robot, 20, seed=7):
        plant.SetPositions(context, q)
        plant.SetVelocities(context, v)
        vdot = rng.uniform(-5.0, 5.0, robot.n)
        terms, forces = evaluate_dynamics(robot, q, v), MultibodyForces(plant)
        forces.mutable_generalized_forces()[:] = plant.CalcGravityGeneralizedForces(context)
        assert_agree(terms.M @ vdot + terms.Cv + terms.g, plant.CalcInverseDynamics(context, vdot, forces))
