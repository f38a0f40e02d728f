"""Tables of stopping times: their files, and what is refused."""

import numpy as np
import pytest

from saphari_drake.errors import ModelError, ParameterError
from saphari_drake.robots import catalog
from saphari_drake.safety.speed_separation.stopping import StoppingTable, extension_of, read_stopping, stopping_of


def test_a_table_survives_its_file(tmp_path):
    table = StoppingTable("arm", 0.9, [0.0, 0.5], [[0.1, 0.2]] * 3, [[0.0, 0.1]] * 3)
    path = tmp_path / "stopping.yaml"
    path.write_text(table.text())
    assert read_stopping(path) == table


@pytest.mark.parametrize("name", ["lwr4", "omnirob"])
def test_shipped_arms_have_theirs(name):
    """Rising with the speed, and with the extension."""
    table = stopping_of(catalog.load(name))
    for rows in (table.time, table.distance):
        assert np.all(np.diff(rows, axis=0) >= 0.0) and np.all(np.diff(rows, axis=1) >= 0.0)
    assert table.speed[-1] >= 1.5


def test_an_arm_without_one_is_told():
    with pytest.raises(ModelError, match=r"planar_6r: no stopping.yaml"):
        stopping_of(catalog.planar_6r())


@pytest.mark.parametrize(
    "text", ["speed: [0, 1]", "speed: [1, 2]", "reach: 0", "nonsense: 1", "time: [[0, 1]]", "- 1", "speed: [0, x]"]
)
def test_what_is_no_table_is_told(tmp_path, text):
    path = tmp_path / "stopping.yaml"
    path.write_text(text)
    if text == "speed: [0, 1]":
        text = read_stopping(path).text()
    else:
        with pytest.raises(ParameterError, match=r"stopping.yaml: no table"):
            read_stopping(path)


def test_rows_are_those_of_the_thirds():
    table = StoppingTable("", 1.0, [0.0, 1.0], [[0, 1], [0, 2], [0, 3]], [[0, 1], [0, 2], [0, 3]])
    assert [table.row(e)[1][1] for e in (0.0, 0.33, 0.34, 0.66, 0.67, 1.0, 1.5)] == [1, 1, 2, 2, 3, 3, 3]
    np.testing.assert_allclose(extension_of(np.array([[1.0, 1.0, 9.0]]), np.array([1.0, 0.5, 0.0]), 2.0), 0.25)
