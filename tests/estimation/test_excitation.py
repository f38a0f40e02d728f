"""Excitation keeps to the limits, begins at rest, and repeats."""

import numpy as np
import pytest

from saphari_drake.errors import ParameterError
from saphari_drake.estimation.excitation import ExcitationParameters, draw_excitation

PARAMS = ExcitationParameters(period=8.0)


@pytest.mark.parametrize("seed", range(3))
def test_a_motion_keeps_its_limits(lwr4, seed):
    motion = draw_excitation(lwr4, PARAMS, np.random.default_rng(seed))
    t = np.linspace(0.0, 24.0, 2401)
    q = motion.at(t)
    v = np.gradient(q, t[1], axis=0)
    assert np.all(q >= lwr4.q_min) and np.all(q <= lwr4.q_max)
    assert np.abs(v[t > 8.0] / lwr4.v_max).max() <= 0.5 + 1e-3 and np.abs(v / lwr4.v_max).max() < 1.0
    np.testing.assert_allclose(q[0], lwr4.home)
    np.testing.assert_allclose(motion.at(9.3), motion.at(17.3), atol=1e-12)
    assert np.abs(motion.at(1e-3) - lwr4.home).max() < 1e-6
    assert min(lwr4.kinematics(x).p_WL[1:, 2].min() for x in q[800:1600:20]) >= PARAMS.height


def test_a_posture_at_its_limit_is_told(lwr4):
    home = lwr4.home.copy()
    home[3] = lwr4.q_max[3]
    with pytest.raises(ParameterError, match="joint_4"):
        draw_excitation(lwr4.with_home(home), PARAMS, np.random.default_rng(0))
