"""Bad parameters are named."""

import pytest

from saphari_drake.errors import ParameterError
from saphari_drake.stations.parameters import StationParameters


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("period", 0.0),
        ("stale_time", -1.0),
        ("end_time", -0.1),
        ("priority", 100),
        ("diagram_priority", -1),
        ("brake_damping", 600.0),
    ],
)
def test_a_bad_value_names_its_field(field, value):
    with pytest.raises(ParameterError, match=field):
        StationParameters(**{field: value})
