"""Dynamics of a state: the LWR4's published figures, passivity, the base pose, and the system that evaluates them."""

import numpy as np
import pytest
from arms import ARMS, TILTED, states
from bench import Bench
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from saphari_drake.errors import StateError
from saphari_drake.robots.catalog import lwr4 as load_lwr4
from saphari_drake.robots.dynamics import RobotDynamics, evaluate_dynamics
from saphari_drake.simulation.sensors.joint_sensor import JointSensor


def test_gravity_torque_with_the_arm_held_out(lwr4):
    """At q2 = 90° the torques are those of the published base parameters."""
    q = np.zeros(7)
    q[1] = np.pi / 2
    expected = [0.0, -47.278, -0.404, 13.367, -0.409, -0.281, -0.009]
    np.testing.assert_allclose(evaluate_dynamics(lwr4, q, np.zeros(7)).g, expected, atol=6e-4)


def test_flange_is_1178_mm_above_the_base_when_stretched(lwr4):
    flange = lwr4.kinematics(np.zeros(7)).p_WL[lwr4.link_index("link_7")]
    np.testing.assert_allclose(flange, [0.0, 0.0, 1.1785], atol=1e-12)


def test_wrist_is_light(lwr4):
    """The smallest eigenvalue of M is that of the last motor, and 1e-4 kg m² without motors: well invertible."""
    smallest = [np.linalg.eigvalsh(evaluate_dynamics(lwr4, q, v).M)[0] for q, v in states(lwr4, 100)]
    bare = min(np.linalg.eigvalsh(evaluate_dynamics(lwr4, lwr4.home, np.zeros(7)).M - np.diag(lwr4.tree.armature)))
    assert 0.8e-4 < bare < 1.3e-4
    assert lwr4.tree.armature[-1] < min(smallest)
    assert max(smallest) < lwr4.tree.armature[-1] + 1.3e-4


@pytest.mark.parametrize("name", ARMS)
def test_inertia_matrix_is_symmetric_and_positive_definite(name, load_arm):
    robot = load_arm(name)
    for q, v in states(robot, 50):
        M = evaluate_dynamics(robot, q, v).M
        np.testing.assert_array_equal(M, M.T)
        assert np.linalg.eigvalsh(M)[0] > 0.0


@pytest.mark.parametrize("name", ARMS)
def test_passive(name, load_arm):
    """Coriolis forces do no work beyond the change of inertia: q̇ᵀCq̇ = q̇ᵀCᵀq̇ = ½q̇ᵀṀq̇, so Ė = q̇ᵀτ."""
    robot, h = load_arm(name), 1e-6
    for q, v in states(robot, 20):
        terms = evaluate_dynamics(robot, q, v)
        assert v @ terms.Cv == pytest.approx(v @ terms.CTv, rel=1e-10, abs=1e-10)
        ahead, behind = (evaluate_dynamics(robot, q + s * h * v, v).M for s in (1, -1))
        assert v @ terms.Cv == pytest.approx(v @ (ahead - behind) @ v / (4 * h), rel=1e-5, abs=1e-6)


def test_gravity_torque_is_the_gradient_of_potential_energy(lwr4):
    plant = MultibodyPlant(0.0)
    lwr4.add_to(plant)
    plant.Finalize()
    context, h = plant.CreateDefaultContext(), 1e-6

    def energy(q):
        plant.SetPositions(context, q)
        return plant.CalcPotentialEnergy(context)

    for q, v in states(lwr4, 5):
        gradient = [(energy(q + h * e) - energy(q - h * e)) / (2 * h) for e in np.eye(7)]
        np.testing.assert_allclose(evaluate_dynamics(lwr4, q, v).g, gradient, atol=1e-7)


def test_no_velocity_no_coriolis(lwr4):
    terms = evaluate_dynamics(lwr4, lwr4.home, np.zeros(7))
    for zero in (terms.Cv, terms.CTv, terms.p, terms.V, terms.A):
        np.testing.assert_array_equal(zero, 0.0)


def test_base_pose_moves_the_arm_and_turns_gravity(lwr4):
    """Points move with X_WB; inertia and Coriolis terms do not depend on it; on the ceiling gravity is reversed."""
    tilted = load_lwr4(TILTED)
    ceiling = load_lwr4(RigidTransform(RollPitchYaw(np.pi, 0.0, 0.0), [0.0, 0.0, 2.0]))
    for q, v in states(lwr4, 10):
        upright, other = evaluate_dynamics(lwr4, q, v), evaluate_dynamics(tilted, q, v)
        for name in ("M", "Cv", "CTv", "p"):
            np.testing.assert_allclose(getattr(other, name), getattr(upright, name), atol=1e-10)
        np.testing.assert_allclose(other.p_WL, (TILTED @ upright.p_WL.T).T, atol=1e-12)
        np.testing.assert_allclose(evaluate_dynamics(ceiling, q, v).g, -upright.g, atol=1e-10)


def test_platform_carries_the_whole_mass(load_arm):
    """A platform's prismatic joint feels all of it as inertia, and its weight along the joint's axis."""
    robot = load_arm("mobile")
    mass = robot.tree.mass.sum()
    assert mass == pytest.approx(30.0 + 3.0 + 1.5 + 0.4)
    for q, v in states(robot, 10):
        terms = evaluate_dynamics(robot, q, v)
        for j in (robot.joint_index("x"), robot.joint_index("y")):
            assert terms.M[j, j] == pytest.approx(mass)
            assert terms.g[j] == pytest.approx(mass * 9.81 * terms.S[j, 5])


@pytest.mark.parametrize("bad", [np.zeros(6), np.zeros((7, 1)), np.full(7, np.nan), np.r_[np.zeros(6), np.inf]])
def test_bad_state_is_refused(lwr4, bad):
    with pytest.raises(StateError, match="positions"):
        evaluate_dynamics(lwr4, bad, np.zeros(7))
    with pytest.raises(StateError, match="velocities"):
        evaluate_dynamics(lwr4, np.zeros(7), bad)


def test_terms_do_not_change_with_the_callers_arrays(lwr4):
    """They are shared and kept, for example as a latched posture."""
    q, v = next(states(lwr4, 1))
    terms, kept = evaluate_dynamics(lwr4, q, v), q.copy()
    q += 1.0
    np.testing.assert_array_equal(terms.q, kept)


def test_latched_samples_survive_the_next_one(lwr4):
    """Terms evaluated from a sensor's held samples do not change when the samples do."""
    builder = DiagramBuilder()
    sensor, system = builder.AddSystem(JointSensor(lwr4)), builder.AddSystem(RobotDynamics(lwr4))
    for name in ("position_measured", "velocity_measured"):
        builder.Connect(sensor.GetOutputPort(name), system.GetInputPort(name))
    builder.ExportInput(sensor.GetInputPort("state"), "state")
    builder.ExportOutput(system.GetOutputPort("dynamics"), "dynamics")
    bench = Bench(builder.Build(), state=np.r_[lwr4.home, np.zeros(7)])
    terms = bench.read("dynamics")
    bench.run(state=np.r_[lwr4.home + 0.5, np.zeros(7)])
    np.testing.assert_allclose(terms.q, lwr4.home, atol=1e-5)
    np.testing.assert_allclose(bench.read("dynamics").q, lwr4.home + 0.5, atol=1e-5)


def in_diagram(robot, q, v):
    builder = DiagramBuilder()
    system = builder.AddSystem(RobotDynamics(robot))
    for value, port in ((q, "position_measured"), (v, "velocity_measured")):
        source = builder.AddSystem(ConstantVectorSource(value))
        builder.Connect(source.get_output_port(), system.GetInputPort(port))
    builder.ExportOutput(system.GetOutputPort("dynamics"), "dynamics")
    diagram = builder.Build()
    return diagram, diagram.CreateDefaultContext()


def test_system_publishes_the_terms_of_its_inputs_and_evaluates_them_once(lwr4):
    q, v = next(states(lwr4, 1))
    diagram, context = in_diagram(lwr4, q, v)
    port = diagram.GetOutputPort("dynamics")
    terms, expected = port.Eval(context), evaluate_dynamics(lwr4, q, v)
    for name in ("q", "v", "M", "Cv", "CTv", "g", "p"):
        np.testing.assert_array_equal(getattr(terms, name), getattr(expected, name))
    assert port.Eval(context) is terms


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("port", ["position_measured", "velocity_measured"])
def test_a_state_that_is_not_finite_is_published_as_unknown_until_it_is_finite_again(lwr4, port, bad):
    """Nothing raises, nothing computes on: all terms are NaN, of the same shapes."""
    bench = Bench(RobotDynamics(lwr4), position_measured=lwr4.home, velocity_measured=np.zeros(7))
    known, value = bench.read("dynamics"), np.r_[bad, np.zeros(6)]
    bench.set(**{port: value})
    unknown = bench.read("dynamics")
    assert known.finite and not unknown.finite
    for name in ("q", "v", "M", "Cv", "CTv", "g", "p", "R_WL", "p_WL", "S", "V", "A"):
        assert getattr(unknown, name).shape == getattr(known, name).shape
        assert np.isnan(getattr(unknown, name)).all()
    bench.set(**{port: getattr(known, "q" if port == "position_measured" else "v")})
    assert bench.read("dynamics").finite
    np.testing.assert_array_equal(bench.read("dynamics").M, known.M)


def test_clone_of_the_context_gives_the_same_terms(lwr4):
    q, v = next(states(lwr4, 1))
    diagram, context = in_diagram(lwr4, q, v)
    first = diagram.GetOutputPort("dynamics").Eval(context)
    np.testing.assert_array_equal(diagram.GetOutputPort("dynamics").Eval(context.Clone()).M, first.M)
