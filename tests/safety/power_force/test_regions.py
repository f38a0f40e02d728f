"""Limits of the regions of the body, and what is refused."""

import numpy as np
import pytest

from saphari_drake.errors import ParameterError, UnknownNameError
from saphari_drake.safety.power_force.regions import FILE, HEAD, BodyRegion, limits_of, read_regions


def test_the_file_warns():
    assert "CHECK AGAINST A LICENSED COPY" in FILE.read_text()


def test_twelve_regions_and_none_of_the_head_may_be_touched():
    regions = read_regions()
    assert len(regions) == 12
    for name, region in regions.items():
        assert (region.energy_free == 0.0) == (name in HEAD)
        assert region.energy_clamped <= max(region.energy_free, 1e-12) or name in HEAD


def test_energies_are_those_of_a_spring():
    region = BodyRegion(force=100.0, transient=2.0, stiffness=1e4)
    assert (region.energy_free, region.energy_clamped) == (2.0, 0.5)
    assert BodyRegion(force=100.0, stiffness=1e4, energy=1.3).energy_free == 1.3


def test_limits_are_taken_by_name():
    limits = limits_of(read_regions(), ["hand", "forearm"])
    np.testing.assert_allclose(limits.mass, [0.6, 2.0])
    with pytest.raises(UnknownNameError, match="knee"):
        limits_of(read_regions(), ["knee"])


@pytest.mark.parametrize("text", ["regions: {hand: {force: -1}}", "regions: {hand: {power: 1}}", "- 1", "x: 1"])
def test_what_is_no_file_of_regions_is_told(tmp_path, text):
    path = tmp_path / "own.yaml"
    path.write_text(text)
    with pytest.raises(ParameterError, match=r"own.yaml"):
        read_regions(path)
