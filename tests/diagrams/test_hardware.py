"""diagrams/hardware.py from the command line: which robot, bad input in one line, and a run on the simulated one."""

import json

import hardware
import numpy as np
import pytest

from saphari_drake.simulation.runner.experiment import main


def called(*arguments):
    return main(hardware.EXPERIMENT, hardware.with_address(arguments))


@pytest.mark.parametrize("given", [["--robot", "lcm"], ["--robot=lcm"]])
def test_the_robot_is_an_address_of_the_scenario(given):
    assert hardware.with_address(["--case", "null_space", *given]) == ["--case", "null_space", "--set", "address=lcm"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--robot", "tcp://10.0.0.1"], ["fci://HOST", "lcm"]),
        (["--robot", "lcm://memq://"], ["IIWA_STATUS"]),
        (["--robot", "fci://127.0.0.1", "--model", "missing.urdf"], ["missing.urdf"]),
        (["--robot", "lcm", "--plant", "realistic"], ["plant", "lcm"]),
        (["--set", "station.priority=200"], ["priority"]),
        (["--set", "rod.link=fr3_link9"], ["fr3_link9"]),
    ],
)
def test_bad_input_is_one_line_and_status_2(capsys, arguments, words):
    assert called("--case", "null_space", *arguments) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert all(word in lines[0] for word in words)


def test_a_touch_is_answered_by_the_simulated_robot(tmp_path):
    """The deflection is F/K_p; log, figure and replay are written."""
    assert called("--case", "contact_impedance", "--duration", "4.2", "--out", str(tmp_path)) == 0
    folder = tmp_path / "contact_impedance"
    figures = json.loads((folder / "metrics.json").read_text())["metrics"]
    assert figures["deflection_share"] == pytest.approx(1.0, abs=0.05)
    with np.load(folder / "log.npz") as log:
        assert {"position_measured", "status", "missed_cycles", "contact_force"} <= set(log.files)
    assert (folder / "figure.png").stat().st_size > 0 and (folder / "replay.html").stat().st_size > 0
