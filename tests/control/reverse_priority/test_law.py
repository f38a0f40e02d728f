"""The law against its plain twin, the recursion as it is printed, and against a general solver; its activation."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from priority_recursion import (
    append_row_inverse,
    augmented_inverse,
    forward_priority,
    regularised_step,
    reverse_priority,
    singular_damping,
)
from scipy.optimize import minimize

from saphari_drake.control.reverse_priority import law

SEEDS = st.integers(0, 10_000)
NUMBERS = st.floats(-2.0, 2.0)


def settings(n, v_max=np.inf, period=1e-4, damping=0.1):
    return law.Settings(np.full(n, v_max), period, damping, 1.0)


def activation(x, rate):
    """Return h of x ≤ 0.5 with buffers of 0.05 and 0.1."""
    return law.activation(x, 0.5, 0.05) * law.activation(rate, 0.0, 0.1)


def random_tasks(rng, sizes, n=7):
    return [rng.standard_normal((m, n)) for m in sizes], [rng.standard_normal(m) for m in sizes]


@given(seed=SEEDS, rows=st.integers(1, 9))
def test_greville_row_update_is_the_pseudo_inverse(seed, rows):
    """Row by row, with every third row a copy or a combination of others, and with more rows than columns."""
    rng = np.random.default_rng(seed)
    R, R_inv = np.zeros((0, 7)), np.zeros((7, 0))
    for k in range(rows):
        row = rng.standard_normal(7)
        if k % 3 == 2:
            row = rng.standard_normal(k) @ R
        R_inv = append_row_inverse(R, R_inv, row)
        R = np.vstack([row, R])
    np.testing.assert_allclose(R_inv, np.linalg.pinv(R, rcond=1e-10), atol=1e-6)


def test_t_is_the_first_columns_of_the_augmented_inverse():
    """Eq. (26)."""
    rng = np.random.default_rng(1)
    J, R = rng.standard_normal((3, 7)), rng.standard_normal((2, 7))
    full = augmented_inverse(J, R, np.linalg.pinv(R))
    np.testing.assert_allclose(full, np.linalg.pinv(np.vstack([J, R])), atol=1e-10)


@given(seed=SEEDS, kind=st.sampled_from(["independent", "dependent", "repeated", "crowded"]))
def test_the_task_on_top_is_exact(seed, kind):
    """Whatever lies below it: independent rows, dependent ones, the same task, or more rows than joints."""
    rng = np.random.default_rng(seed)
    jacobians, rates = random_tasks(rng, (3, 6, 5) if kind == "crowded" else (3, 2, 2))
    if kind == "dependent":
        jacobians[1] = rng.standard_normal((2, 3)) @ jacobians[0]
    if kind == "repeated":
        jacobians[2] = jacobians[0][:2].copy()
    v = reverse_priority(jacobians, rates, rng.standard_normal(7))
    np.testing.assert_allclose(jacobians[0] @ v, rates[0], atol=1e-7 * (1 + np.abs(v).max()))


@given(seed=SEEDS)
def test_reverse_and_forward_agree_for_independent_tasks(seed):
    """To 5e-12, relative to the size of the solution and the conditioning of the rows."""
    rng = np.random.default_rng(seed)
    jacobians, rates = random_tasks(rng, (2, 3, 1))
    v_null = rng.standard_normal(7)
    reverse, forward = reverse_priority(jacobians, rates, v_null), forward_priority(jacobians, rates, v_null)
    condition = np.linalg.cond(np.vstack(jacobians))
    np.testing.assert_allclose(
        reverse, forward, atol=5e-12 * max(1.0, condition / 10) * max(1.0, np.abs(forward).max())
    )


@given(seed=SEEDS)
def test_each_step_deforms_the_levels_below_the_least_and_is_the_shortest_of_those(seed):
    """δ = argmin ‖δ‖ over argmin ‖R δ‖ subject to J δ = b, solved here through the null space of J."""
    rng = np.random.default_rng(seed)
    (J, R), (b, low) = random_tasks(rng, (2, 3))
    R[2] = rng.standard_normal(2) @ J  # one row of the lower level lies in the upper task
    v_null = rng.standard_normal(7)
    below = reverse_priority([R], [low], v_null)
    step = reverse_priority([J, R], [b, low], v_null) - below
    particular = np.linalg.pinv(J) @ (b - J @ below)
    N = np.linalg.svd(J)[2][2:].T
    y = np.linalg.pinv(R @ N, rcond=1e-9) @ (-R @ particular)
    best = particular + N @ y
    np.testing.assert_allclose(R @ step, R @ best, atol=1e-8 * (1 + np.abs(best).max()))
    np.testing.assert_allclose(step, best, atol=1e-7 * (1 + np.abs(best).max()))


@given(seed=SEEDS)
def test_the_regularised_step_tends_to_the_exact_one(seed):
    """As λ_s → 0, for a task in conflict with the level below it."""
    rng = np.random.default_rng(seed)
    (J, R), (b, _) = random_tasks(rng, (2, 3))
    R[2] = rng.standard_normal(2) @ J
    exact = reverse_priority([J, R], [b, np.zeros(3)], np.zeros(7))
    errors = []
    for lam_s in (1e-1, 1e-2, 1e-3):
        W = lam_s**2 * np.eye(7) + R.T @ R
        errors.append(np.linalg.norm(regularised_step(J, b, W, singular_damping(J, lam_s, 1.0)) - exact))
    scale = 1 + np.linalg.norm(exact)
    assert errors[2] < errors[0] + 1e-9 * scale
    assert errors[2] < 2e-2 * scale


def test_at_a_singular_posture_the_regularised_step_is_bounded_and_the_exact_one_is_not():
    """A row that fades out: the damped step stays below b/λ_s, the exact one grows without bound."""
    b, lam_s = np.array([0.5, 0.5]), 0.1
    for fade in 10.0 ** np.arange(-1.0, -7.0, -1.0):
        J = np.array([[1.0, 0.0, 0.0], [0.0, fade, 0.0]])
        W = lam_s**2 * np.eye(3)
        assert np.abs(regularised_step(J, b, W, singular_damping(J, lam_s, 1.0))).max() < 0.5 / lam_s
    assert np.abs(reverse_priority([J], [b], np.zeros(3))).max() > 1e5


@given(seed=SEEDS)
def test_the_compiled_task_step_is_the_plain_one(seed):
    rng = np.random.default_rng(seed)
    (J, R), (b, _) = random_tasks(rng, (3, 2))
    W = 0.01 * np.eye(7) + R.T @ R
    v = np.zeros(7)
    law.task_step(np.linalg.cholesky(W), J, b, settings(7), v)
    np.testing.assert_allclose(v, regularised_step(J, b, W, singular_damping(J, 0.1, 1.0)), atol=1e-9)


def constraints(J, x, buffer=0.1):
    """Return rows of x ≤ 0."""
    zero, some = np.zeros(len(x)), np.full(len(x), buffer)
    return law.Rows(J, x, zero, zero, zero, some, some)


def one_level(J, x, v):
    """Step of one level of constraints on top of W = I, all with buffers of 0.1."""
    v, h = v.copy(), np.zeros(len(x))
    law.constraint_step(np.eye(J.shape[1]), constraints(J, x), settings(J.shape[1], 1e9), v, h)
    return v, h


@given(seed=SEEDS, x=st.floats(-0.12, 0.02))
def test_one_constraint_is_the_rule_of_the_deliverable(seed, x):
    """Eq. (32): towards the bound its velocity becomes (1 − h) ẋ_d; away from it nothing changes."""
    rng = np.random.default_rng(seed)
    J, v = rng.standard_normal((1, 4)), rng.standard_normal(4)
    before = float((J @ v)[0])
    after, h = one_level(J, np.array([x]), v)
    wanted = (1.0 - h[0]) * before if before > 0.0 else before
    np.testing.assert_allclose((J @ after)[0], wanted, atol=1e-6)


@given(seed=SEEDS)
def test_constraints_at_their_bounds_hold_together_with_the_least_change(seed):
    """The same optimum as a general solver: min ‖δ‖ subject to J (v + δ) ≤ 0, with dependent rows among them."""
    rng = np.random.default_rng(seed)
    J, v = rng.standard_normal((5, 4)), rng.standard_normal(4)
    J[4] = J[0]
    after, _ = one_level(J, np.zeros(5), v)
    assert (J @ after).max() < 1e-5
    reference = minimize(
        lambda y: 0.5 * np.sum((y - v) ** 2),
        np.zeros(4),
        jac=lambda y: y - v,
        constraints={"type": "ineq", "fun": lambda y: -J @ y, "jac": lambda y: -J},
        options={"ftol": 1e-14, "maxiter": 300},
    )
    np.testing.assert_allclose(np.sum((after - v) ** 2), np.sum((reference.x - v) ** 2), rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_the_step_is_continuous_through_activation_and_release(direction):
    """Swept through the buffer, no change of velocity exceeds what the slope of the activation allows."""
    J, v = np.array([[1.0, 0.5, 0.0], [0.8, 0.0, 0.6]]), np.array([1.0, 0.2, -0.3])
    grid = np.linspace(-0.15, 0.0, 3001)[:: int(direction)]
    steps = np.array([one_level(J, np.array([x, x - 0.03]), v)[0] for x in grid])
    change = np.abs(np.diff(steps, axis=0)).max() / abs(grid[1] - grid[0])
    rate, shortest = np.abs(J @ v).max(), np.linalg.norm(np.linalg.pinv(J), 2)
    assert change <= 15.0 / 8.0 / 0.1 * rate * shortest


@pytest.mark.parametrize("gap", [1e-3, 0.02, 0.2])
def test_a_fast_step_covers_half_of_what_is_left_to_a_bound(gap):
    """However narrow the buffer, a velocity that would jump the bound within one period is cut to half the gap."""
    period, v, h = 0.01, np.array([50.0, 1.0]), np.zeros(1)
    rows = constraints(np.array([[1.0, 0.0]]), np.array([-gap]), 1e-9)
    law.constraint_step(np.eye(2), rows, settings(2, 1e9, period), v, h)
    assert v[0] * period == pytest.approx(0.5 * gap, rel=1e-3)
    assert v[1] == 1.0


@given(x=NUMBERS, rate=NUMBERS)
def test_activation_is_1_where_the_rule_says_so_and_0_outside_the_buffers(x, rate):
    """Eq. (31) at the bound and beyond; nothing before the buffer or while leaving fast."""
    h = activation(x, rate)
    assert 0.0 <= h <= 1.0
    if x >= 0.5 and rate >= 0.0:
        assert h == 1.0
    if x <= 0.45 or rate <= -0.1:
        assert h < 1e-12


@given(x=NUMBERS, rate=NUMBERS, dx=st.floats(-0.01, 0.01), drate=st.floats(-0.01, 0.01))
def test_a_small_change_changes_the_activation_little(x, rate, dx, drate):
    """|Δh| ≤ 15/8 (|Δx|/β_p + |Δẋ|/β_v)."""
    before, after = activation(x, rate), activation(x + dx, rate + drate)
    assert abs(after - before) <= 15.0 / 8.0 * (abs(dx) / 0.05 + abs(drate) / 0.1) + 1e-12
