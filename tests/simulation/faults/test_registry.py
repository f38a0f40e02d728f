"""Faults by name: which there are, where they can be, and what is said of others."""

import numpy as np
import pytest

from saphari_drake.errors import ParameterError, UnknownNameError
from saphari_drake.simulation.faults.registry import FAULTS, PARTS, STATIC, FaultSizes, listed, possible, require_faults


def test_every_fault_acts_on_a_part_and_is_listed():
    assert {fault.part for fault in FAULTS.values()} == set(PARTS)
    assert set(STATIC) < set(FAULTS)
    assert all(name in listed() and fault.about in listed() for name, fault in FAULTS.items())


def test_a_fault_needs_its_part():
    assert set(possible(["skin"])) == {"skin_dead", "skin_lost"}
    require_faults(["skin_dead"], ["skin"])
    with pytest.raises(UnknownNameError, match="no fault here 'skin_dead'; there are: camera_dropout"):
        require_faults(["skin_dead"], ["camera"])
    with pytest.raises(UnknownNameError, match="no fault 'rust'; there are: wrist_biased"):
        require_faults(["rust"], ["wrist"])


@pytest.mark.parametrize(("name", "value"), [("torque_bias", np.nan), ("blind_share", 1.0), ("glitch_time", 0.0)])
def test_sizes_name_what_is_wrong(name, value):
    with pytest.raises(ParameterError, match=name):
        FaultSizes(**{name: value})
