"""Blocks of numbers arrive whole or not at all, from whatever process writes them."""

import subprocess
import sys

import numpy as np

from saphari_drake.stations.shared import open_link

WRITER = """
import sys
from pathlib import Path
from saphari_drake.stations.shared import open_link
link = open_link(7, Path(sys.argv[1]))
for k in range(50000):
    link.reading.write(position=k, velocity=k, stamp=k)
"""


def test_a_block_is_never_torn():
    """A writer in another process gives one number to all fields: no reader sees two."""
    link = open_link(7)
    process = subprocess.Popen([sys.executable, "-c", WRITER, str(link.path)])
    seen, count = set(), 0
    while process.poll() is None:
        told = link.reading.read()
        if told is not None:
            values = np.concatenate([told["position"], told["velocity"], told["stamp"]])
            assert np.all(values == values[0])
            seen.add(values[0])
            count += 1
    assert process.returncode == 0
    assert link.reading.read()["position"][0] == 49999.0
    link.path.unlink()
    assert len(seen) > 2 and count > 2


def test_a_writer_that_died_in_the_middle_gives_nothing():
    link = open_link(2)
    link.reading.write(position=[1.0, 2.0])
    link.reading._count[0] += 1
    assert link.reading.read() is None
    link.path.unlink()


def test_named_fields_alone_change():
    link = open_link(2)
    link.command.write(torque=[1.0, 2.0], time=3.0)
    link.command.write(close=1.0)
    told = link.command.read()
    assert np.array_equal(told["torque"], [1.0, 2.0]) and told["time"][0] == 3.0 and told["close"][0] == 1.0
    assert link.reading.read()["position"].shape == (2,)
    link.path.unlink()
