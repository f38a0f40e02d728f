"""Parameters of the controllers of a contact: every bad one is named."""

import numpy as np
import pytest
from bench import PERIOD
from pydrake.common.yaml import yaml_dump_typed, yaml_load_typed

from saphari_drake.control.contact.parameters import ContactForceControlParameters, ContactImpedanceParameters
from saphari_drake.errors import ParameterError


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("K_p", -1.0),
        ("K_p", [500.0, 500.0]),
        ("K_d", [80.0, np.nan, 80.0]),
        ("M_d", [20.0, 0.0, 10.0]),
        ("M_d", [20.0, -3.0, 10.0]),
        ("M_d", [20.0, 3.0]),
        ("K_N", -20.0),
        ("misfit_lever", -0.01),
        ("max_effective_mass", 0.0),
        ("period", 0.0),
    ],
)
def test_bad_impedance_parameters(name, value):
    with pytest.raises(ParameterError, match=f"^{name}: "):
        ContactImpedanceParameters(**{name: value})


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("direction", "sideways"), ("desired_force", 0.0), ("fixed_force", [1.0, 2.0]), ("fixed_force", [np.nan, 0, 0]),
        ("K_f", -1.0), ("K_d", [1.0, 2.0]), ("M_d", [1.0, -1.0, 1.0]), ("K_N", np.nan), ("gate_on", -1.0),
        ("gate_off", 4.0), ("speed_limit", 0.0),
        ("stop_share", 1.1), ("stop_lead", -0.1), ("force_rate", -1.0), ("max_deficit", 0.0),
        ("hand_stiffness", -1.0), ("period", 0.0),
    ],
)  # fmt: skip
def test_bad_parameters_name_the_field(field, value):
    with pytest.raises((ParameterError, KeyError), match=field):
        ContactForceControlParameters(**{field: value})


def test_parameters_load_with_drake_s_own_loader():
    text = yaml_dump_typed(ContactForceControlParameters(direction="fixed", K_f=2.0))
    assert yaml_load_typed(schema=ContactForceControlParameters, data=text).K_f == 2.0


def test_period_is_that_of_the_cycle():
    assert ContactForceControlParameters().period == PERIOD
