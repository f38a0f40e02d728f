"""What was identified of a robot, as a file and as a model."""

import numpy as np
import pytest

from saphari_drake.errors import ParameterError
from saphari_drake.robots.corrections import RobotCorrections, corrected
from saphari_drake.robots.dynamics import evaluate_dynamics


def test_a_model_takes_payload_scale_and_rotors(lwr4):
    found = RobotCorrections([0.3] * 7, [1.0] * 7, [], [0.2] * 7, [1.1] * 7, 2.0, [0.01, 0.0, 0.1])
    robot, zero = corrected(lwr4, found), np.zeros(7)
    own, other = (evaluate_dynamics(model, lwr4.home, zero) for model in (lwr4, robot))
    J = own.point(6, np.array([0.01, 0.0, 0.1])).Jv_WC
    np.testing.assert_allclose(other.g, 1.1 * own.g + J.T @ [0.0, 0.0, 2.0 * 9.81], atol=1e-9)
    expected = 1.1 * (own.M - np.diag(lwr4.tree.armature)) + 2.0 * J.T @ J + 0.2 * np.eye(7)
    np.testing.assert_allclose(other.M, expected, atol=1e-9)
    again = corrected(robot, RobotCorrections())
    np.testing.assert_allclose(evaluate_dynamics(again, lwr4.home, zero).M, own.M)


def test_a_file_is_read_as_it_was_written(tmp_path, lwr4):
    found, path = RobotCorrections(coulomb=[0.1] * 7, payload=0.5), tmp_path / "identified.yaml"
    path.write_text(found.text(), encoding="utf-8")
    assert RobotCorrections.read(path) == found
    path.write_text("rust: 3\n", encoding="utf-8")
    with pytest.raises(ParameterError, match="identified"):
        RobotCorrections.read(path)
    with pytest.raises(ParameterError, match="absent"):
        RobotCorrections.read(tmp_path / "absent.yaml")


def test_a_wrong_size_or_number_is_named(lwr4):
    with pytest.raises(ParameterError, match="link_scale"):
        corrected(lwr4, RobotCorrections(link_scale=[0.1] * 6))
    with pytest.raises(ParameterError, match="payload"):
        RobotCorrections(payload=np.nan)
