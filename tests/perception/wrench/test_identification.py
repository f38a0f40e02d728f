"""A tool identified from readings at rest: made-up ones, with noise, and those of a robot from a file."""

import numpy as np
import pytest
from pydrake.math import RollPitchYaw, RotationMatrix

from saphari_drake.errors import StateError
from saphari_drake.perception.wrench.identification import identify_tool, main
from saphari_drake.perception.wrench.tool import ToolParameters, sensor_mount, tool_wrench
from saphari_drake.robots.dynamics import evaluate_dynamics

G = np.array([0.0, 0.0, -9.81])


def test_identification_of_many_noisy_postures():
    rng = np.random.default_rng(0)
    tool, bias = ToolParameters(1.2, [0.01, 0.02, 0.07]), np.array([0.1, 0.0, -0.1, 3.0, -1.0, 2.0])
    R_WS = np.array([RollPitchYaw(*rng.uniform(-3.0, 3.0, 3)).ToRotationMatrix().matrix() for _ in range(60)])
    noise = rng.normal(size=(60, 6)) * [0.002, 0.002, 0.002, 0.05, 0.05, 0.05]
    found = identify_tool(R_WS, np.array([tool_wrench(tool, R, G) for R in R_WS]) + bias + noise, G)
    assert found.tool.mass == pytest.approx(1.2, abs=0.005)
    np.testing.assert_allclose(found.tool.com, tool.com, atol=2e-4)
    np.testing.assert_allclose(found.bias, bias, atol=0.03)
    assert found.residual_force == pytest.approx(0.05, rel=0.2)


def test_postures_that_do_not_tell_are_refused():
    """Turning about the vertical alone leaves weight and bias mixed."""
    upright = np.array([RotationMatrix.MakeZRotation(a).matrix() for a in np.linspace(0.0, 6.0, 8)])
    with pytest.raises(StateError, match="cannot be told apart"):
        identify_tool(upright, np.ones((8, 6)), G)
    with pytest.raises(StateError, match="do not go with"):
        identify_tool(upright, np.ones((7, 6)), G)
    with pytest.raises(StateError, match="not finite"):
        identify_tool(upright, np.full((8, 6), np.nan), G)


def test_the_tool_of_a_robot_is_identified_from_a_file(lwr4, tmp_path, capsys):
    """Readings of the last link's weight in five postures give its mass and centre of mass back."""
    link, X_LS, tool = sensor_mount(lwr4, "joint_7")
    rows = []
    for q in np.random.default_rng(0).uniform(-1.5, 1.5, (5, 7)):
        R_WL = evaluate_dynamics(lwr4, q, np.zeros(7)).R_WL[link]
        rows.append([*q, *(tool_wrench(tool, R_WL @ X_LS.rotation().matrix(), G) + 0.5)])
    np.savetxt(tmp_path / "readings.csv", rows, delimiter=",", header="q, tau, f")
    main(["lwr4", str(tmp_path / "readings.csv")])
    said = capsys.readouterr().out
    assert f"mass: {tool.mass:.4f}" in said
    assert f"com: {np.round(tool.com, 4).tolist()}" in said
    assert "bias: [0.5, 0.5, 0.5, 0.5, 0.5, 0.5]" in said


@pytest.mark.parametrize(
    ("rows", "words"), [("1, 2, 3", "has 7 joints"), ("a, b", "could not convert"), (None, "not found")]
)
def test_readings_that_cannot_be_used_are_one_line(tmp_path, capsys, rows, words):
    path = tmp_path / "readings.csv"
    if rows is not None:
        path.write_text(rows)
    with pytest.raises(SystemExit) as stopped:
        main(["lwr4", str(path)])
    assert stopped.value.code == 2
    assert words in capsys.readouterr().err
