"""The activation of a unilateral constraint: its values at the ends, its smoothness and its steepest slope."""

from hypothesis import given
from hypothesis import strategies as st

from saphari_drake.control.reverse_priority.activation import (
    activation,
    position_activation,
    velocity_activation,
)

NUMBERS = st.floats(-2.0, 2.0)


@given(x=NUMBERS, rate=NUMBERS)
def test_activation_is_1_where_the_rule_says_so_and_0_outside_the_buffers(x, rate):
    """Eq. (31) at the bound and beyond; nothing before the buffer or while leaving fast."""
    h = activation(x, rate, 0.5, 0.05, 0.1)
    assert 0.0 <= h <= 1.0
    if x >= 0.5 and rate >= 0.0:
        assert h == 1.0
    if x <= 0.45 or rate <= -0.1:
        assert h < 1e-12


@given(x=NUMBERS, rate=NUMBERS, dx=st.floats(-0.01, 0.01), drate=st.floats(-0.01, 0.01))
def test_a_small_change_changes_the_activation_little(x, rate, dx, drate):
    """|Δh| ≤ 15/8 (|Δx|/β_p + |Δẋ|/β_v)."""
    before, after = activation(x, rate, 0.5, 0.05, 0.1), activation(x + dx, rate + drate, 0.5, 0.05, 0.1)
    assert abs(after - before) <= 15.0 / 8.0 * (abs(dx) / 0.05 + abs(drate) / 0.1) + 1e-12


def test_it_is_the_product_of_its_parts():
    """h = h_pos h_vel."""
    h = activation(0.48, -0.03, 0.5, 0.05, 0.1)
    assert h == position_activation(0.48, 0.5, 0.05) * velocity_activation(-0.03, 0.1)
    assert 0.0 < h < 1.0
