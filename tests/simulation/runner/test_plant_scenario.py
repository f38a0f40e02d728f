"""A scenario says which plant and which faults; what is true of the robot follows from it."""

import numpy as np
import pytest

from saphari_drake.errors import ParameterError, UnknownNameError
from saphari_drake.estimation.momentum_observer import MomentumObserverParameters
from saphari_drake.robots.corrections import RobotCorrections
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.simulation.runner.plant_scenario import PlantScenario
from saphari_drake.simulation.world.profile import PlantProfile, realistic


def test_the_plant_is_ideal_unless_it_is_asked_for():
    assert PlantScenario().truth(0.001).profile == PlantProfile()
    truth = PlantScenario(plant="realistic", seed=3).truth(0.005)
    assert (truth.profile, truth.seed, truth.period) == (realistic(), 3, 0.005)
    with pytest.raises(UnknownNameError, match="no plant 'real'; there are: ideal, realistic"):
        PlantScenario(plant="real")


def test_faults_begin_when_they_are_told_to_or_by_the_seed():
    assert PlantScenario(faults=["torque_bias"], fault_time=1.5).truth(0.001).faults == {"torque_bias": 1.5}
    starts = [PlantScenario(duration=10.0, seed=k, faults=["encoder_nan"]).fault_start() for k in range(50)]
    assert 2.0 <= min(starts) < 2.5 and 5.5 < max(starts) <= 6.0
    assert PlantScenario(faults=["payload"]).truth(0.001).faults == {"payload": 0.0}
    with pytest.raises(UnknownNameError, match="rust"):
        PlantScenario(faults=["rust"])
    with pytest.raises(ParameterError, match="fault_time"):
        PlantScenario(fault_time=np.nan)


def test_faults_of_the_plant_change_its_profile():
    scenario = PlantScenario(plant="realistic", faults=["payload", "model_error", "friction_double"])
    profile = scenario.truth(0.001).profile
    assert (profile.payload, profile.mass_error) == (1.2, 0.1)
    assert (profile.viscous, profile.coulomb) == (2.0, 0.6)


def test_what_was_identified_is_known_to_controllers_and_observer(tmp_path, lwr4):
    path, observer = tmp_path / "identified.yaml", MomentumObserverParameters()
    path.write_text(RobotCorrections(coulomb=[0.3] * 7, payload=1.0).text(), encoding="utf-8")
    known = PlantScenario(identified=str(path)).known(lwr4, observer)
    zero = np.zeros(7)
    assert evaluate_dynamics(known, lwr4.home, zero).g[1] != evaluate_dynamics(lwr4, lwr4.home, zero).g[1]
    assert observer.friction.coulomb == [0.3] * 7 and PlantScenario().known(lwr4) is lwr4
