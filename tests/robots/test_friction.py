"""Friction of joints: against the motion, whole beyond break-away, without a jump at rest."""

import numpy as np

from saphari_drake.robots.friction import BREAK_AWAY, JointFriction


def test_it_grows_from_nothing_to_all():
    friction = JointFriction(np.array([0.3, 0.0]), np.array([0.0, 2.0]))
    assert np.all(friction.torque(np.zeros(2)) == 0.0)
    np.testing.assert_allclose(friction.torque([0.5, 0.5]), [0.3, 1.0], atol=1e-9)
    np.testing.assert_allclose(friction.torque([-0.5, -0.5]), [-0.3, -1.0], atol=1e-9)
    assert 0.2 < friction.torque([BREAK_AWAY, 0.0])[0] < 0.25
