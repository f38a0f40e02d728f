"""The model with the plant's own masses is the plant's, and tells what an observer sees of the difference."""

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder

from saphari_drake.robots.catalog import lwr4, omnirob
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.simulation.world.cell import add_cell
from saphari_drake.simulation.world.plant import PlantParameters
from saphari_drake.simulation.world.profile import PlantProfile, Truth, realistic
from saphari_drake.simulation.world.true_model import resting_residual, true_robot


@pytest.mark.parametrize("robot", [lwr4(), omnirob()], ids=["lwr4", "omnirob"])
@pytest.mark.parametrize("seed", [0, 1])
def test_masses_of_model_and_plant_agree(robot, seed):
    """With friction too, whose brakes are actuators of the same joints and must not change the motors' inertia."""
    truth = Truth(realistic(), seed)
    cell = add_cell(DiagramBuilder(), robot, plant=PlantParameters(payload=0.5), truth=truth)
    context = cell.plant.CreateDefaultContext()
    q = robot.home + 0.2 * np.random.default_rng(seed).standard_normal(robot.n)
    cell.plant.SetPositions(context, q)
    terms = evaluate_dynamics(true_robot(robot, truth, 0.5), q, np.zeros(robot.n))
    np.testing.assert_allclose(cell.plant.CalcMassMatrix(context), terms.M, atol=1e-9)
    np.testing.assert_allclose(-cell.plant.CalcGravityGeneralizedForces(context), terms.g, atol=1e-9)


@pytest.mark.parametrize("share", [0.0, 0.5])
def test_brakes_leave_the_motors_inertia(share):
    robot = lwr4()
    cell = add_cell(DiagramBuilder(), robot, plant=PlantParameters(friction_share=share))
    M = cell.plant.CalcMassMatrix(cell.plant.CreateDefaultContext())
    np.testing.assert_allclose(M, evaluate_dynamics(robot, robot.home, np.zeros(7)).M, atol=1e-9)


def test_what_is_felt_at_rest(lwr4):
    """Nothing of an ideal plant; of a payload its weight, with the sign of a push; friction up to its limit."""
    rng = np.random.default_rng(0)
    assert np.abs(resting_residual(lwr4, Truth(), lwr4.home, rng)).max() < 1e-12
    felt = resting_residual(lwr4, Truth(PlantProfile(payload=1.0)), lwr4.home, rng)
    J = evaluate_dynamics(lwr4, lwr4.home, np.zeros(7)).point(6, np.array([0.0, 0.0, 0.05])).Jv_WC
    np.testing.assert_allclose(felt, J.T @ [0.0, 0.0, -9.81], atol=1e-9)
    dry = np.array([resting_residual(lwr4, Truth(PlantProfile(coulomb=0.3)), lwr4.home, rng) for _ in range(300)])
    assert 0.28 < np.abs(dry).max() <= 0.3
