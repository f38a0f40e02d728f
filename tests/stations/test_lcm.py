"""A station against Drake's driver of the iiwa in another process, and a diagram that is killed."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from drake import lcmt_iiwa_status
from pydrake.lcm import DrakeLcm
from station_swing import swing

from saphari_drake.stations import StationParameters, StationProcess, StationStatus

URL = f"udpm://239.255.76.67:{20000 + os.getpid() % 20000}?ttl=0"
ROOT = Path(__file__).parents[2]
ENVIRONMENT = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "diagrams")])}


@pytest.fixture(scope="module")
def driver():
    """Address of a simulated driver."""
    command = [sys.executable, "-m", "experiments.hardware.iiwa_driver", URL, "lwr4", "120"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, env=ENVIRONMENT) as process:
        assert process.stdout.readline() == b"ready\n"
        yield f"lcm://{URL}"
        process.kill()


def listen(seconds):
    """Return times, positions and velocities that the driver tells for some seconds."""
    lcm, rows = DrakeLcm(URL), []

    def receive(raw):
        status = lcmt_iiwa_status.decode(raw)
        rows.append((time.monotonic(), status.joint_position_measured, status.joint_velocity_estimated))

    lcm.Subscribe("IIWA_STATUS", receive)
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        lcm.HandleSubscriptions(5)
    return tuple(np.array(column) for column in zip(*rows))


def test_a_diagram_moves_the_arm_and_leaves_it_standing(driver, lwr4):
    params = StationParameters()
    with StationProcess(driver, lwr4, params) as process:
        followed = swing(process, lwr4, params, 1.5)
        told = process.link.reading.read()
        assert followed.running and followed.cycles == 750
        assert told["status"][0] in (StationStatus.OK, StationStatus.STALE)  # too old on a machine that is too busy
        assert np.abs(told["position"] - lwr4.home).max() > 0.02
    assert not process.running and process.said() == ""
    _, _, v = listen(0.2)
    assert np.abs(v).max() < 0.05


def test_the_arm_stops_when_the_process_of_its_diagram_is_killed(driver, lwr4):
    """Within all limits, within 0.5 s, and the loop ends by itself."""
    command = [sys.executable, Path(__file__).parents[1] / "station_swing.py", driver, "lwr4", "20"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, env=ENVIRONMENT) as process:
        loop = int(process.stdout.readline().split()[1])
        time.sleep(1.0 + np.random.default_rng().uniform())
        process.send_signal(signal.SIGKILL)
        t, q, v = listen(1.5)
    assert np.all(np.abs(v) <= lwr4.v_max)
    assert np.all((q > lwr4.q_min) & (q < lwr4.q_max))
    assert np.abs(v[t > t[0] + 0.5]).max() < 0.05
    end = time.monotonic() + 5.0
    while alive(loop) and time.monotonic() < end:
        time.sleep(0.05)
    assert not alive(loop)


def alive(pid):
    """Return whether a process runs; one that nobody has waited for does not."""
    try:
        return "Z" not in Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0]
    except FileNotFoundError:
        return False
