"""One joint alone: whatever is asked of it within its bounds, it can always stop in time."""

import numpy as np
import pytest

from saphari_drake.safety.joint_envelope.stopping import (
    RETURN_SPEED,
    fastest,
    kept_acceleration,
    largest_acceleration,
    speed_bound,
    stop_position,
)

T = 0.001


def commands(rng, kind, A, count):
    """Return accelerations that are asked for: fully forward, noise, a square wave, or plateaus."""
    if kind == "forward":
        return np.full(count, 1e9)
    if kind == "noise":
        return 1e4 * rng.normal(size=count)
    if kind == "square":
        return 1e4 * np.sign(np.sin(np.arange(count) * rng.uniform(0.005, 0.1)))
    return np.repeat(3.0 * A * rng.normal(size=count), rng.integers(1, 200, count))[:count]


@pytest.mark.parametrize("kind", ["forward", "noise", "square", "plateaus"])
@pytest.mark.parametrize("seed", range(60))
def test_limits_hold_and_bounds_never_contradict_the_jerk(kind, seed):
    """At each step the bounds of both sides and the reachable accelerations have some value in common."""
    rng = np.random.default_rng([seed, len(kind)])
    A = 10.0 ** rng.uniform(0.0, 2.0)
    J, v_max, q_max = A * 10.0 ** rng.uniform(1.0, 2.5), rng.uniform(0.5, 4.0), rng.uniform(0.5, 3.0)
    q, v, a = rng.uniform(-0.3, 0.3) * q_max, 0.0, 0.0
    for wish in commands(rng, kind, A, 2000):
        high = min(largest_acceleration(q, v, q_max, v_max, A, J, T), a + J * T)
        low = max(-largest_acceleration(-q, -v, q_max, v_max, A, J, T), a - J * T)
        assert low <= high + 1e-9 * (1.0 + abs(high))
        a = min(max(wish, low), high)
        q, v = q + v * T + 0.5 * a * T * T, v + a * T
        assert abs(v) <= v_max * (1.0 + 1e-9)
        assert abs(q) <= q_max + 1e-9


def test_the_speed_limit_is_reached():
    """The bounds are not won by standing still."""
    q = v = a = 0.0
    for _ in range(1000):
        a = min(largest_acceleration(q, v, 100.0, 2.0, 10.0, 200.0, T), a + 200.0 * T)
        q, v = q + v * T + 0.5 * a * T * T, v + a * T
    assert v > 0.97 * 2.0


@pytest.mark.parametrize("seed", range(200))
def test_stops_in_periods_end_no_farther_than_told(seed):
    """A stop whose acceleration changes at the beginning of each period stays behind the continuous one."""
    rng = np.random.default_rng(seed)
    A, J = 10.0 ** rng.uniform(0.0, 2.0), 10.0 ** rng.uniform(2.0, 4.0)
    v, a = rng.uniform(-1.0, 3.0), rng.uniform(-A, 2.0 * A)
    told, q, farthest = stop_position(v, a, A, J, T), 0.0, 0.0
    speed, acceleration = v, a
    for _ in range(20000):
        for s in (0.25 * T, 0.5 * T, 0.75 * T, T):
            farthest = max(farthest, q + speed * s + 0.5 * acceleration * s * s)
        q, speed = q + speed * T + 0.5 * acceleration * T * T, speed + acceleration * T
        acceleration = max(acceleration - J * T, min(-A, acceleration))
        if speed <= 0.0 and acceleration <= 0.0:
            break
    assert farthest <= told + 1e-12
    # Nor much less far: one period of delay, at the speed and acceleration that it begins with.
    assert told - farthest <= 2.5 * T * (abs(v) + a * a / J + abs(a) * 2.0 * np.sqrt(2.0 * abs(v) / A)) + 1e-6


@pytest.mark.parametrize("seed", range(20))
def test_the_fastest_is_what_a_joint_comes_to(seed):
    """It keeps a for a period and lowers it with the jerk: the largest velocity of that motion, by its integral."""
    rng = np.random.default_rng(seed)
    v, a, J, period = rng.uniform(-2.0, 2.0), rng.uniform(-20.0, 40.0), 10.0 ** rng.uniform(2.0, 3.0), 0.005
    times = np.linspace(0.0, period + max(a, 0.0) / J, 20001)
    acceleration = np.where(times <= period, a, a - J * (times - period))
    steps = 0.5 * (acceleration[1:] + acceleration[:-1]) * np.diff(times)
    assert fastest(v, a, J, period) == pytest.approx(max(v, np.max(v + np.cumsum(steps))), abs=1e-4)


@pytest.mark.parametrize("left", [1e-4, 0.02, 1.0])
def test_the_bound_of_the_speed_uses_it_up(left):
    """After a period with that acceleration the fastest is the limit, no less."""
    a = speed_bound(1.0, 1.0 + left, 200.0, T)
    assert fastest(1.0 + a * T, a, 200.0, T) == pytest.approx(1.0 + left, rel=1e-12)


@pytest.mark.parametrize("seed", range(300))
def test_no_position_limit_asks_for_more_than_the_fullest_stop(seed):
    """From any state near the limit or outside; where that stop ends before it the bound is the one that keeps it."""
    rng = np.random.default_rng(seed)
    A = 10.0 ** rng.uniform(0.0, 2.0)
    J, v_max, q_max = A * 10.0 ** rng.uniform(1.0, 2.5), rng.uniform(0.5, 4.0), rng.uniform(0.5, 3.0)
    q, v, a = q_max + rng.normal() * 10.0 ** rng.uniform(-6.0, 0.0), rng.normal() * v_max, rng.normal() * A
    fullest = max(a - 2.0 * J * T, -A)
    bound = kept_acceleration(q, v, a, q_max, 0.001, v_max, A, J, 2.0 * J, T)
    end = q + v * T + 0.5 * fullest * T * T + stop_position(v + fullest * T, fullest, A, J, T)
    if end <= q_max + 0.001 or q >= q_max + 0.001:
        assert bound >= min(fullest, speed_bound(v, v_max, J, T))
    if max(q, end) <= q_max:
        assert bound == largest_acceleration(q, v, q_max, v_max, A, J, T)


@pytest.mark.parametrize("noise", [0.0, 1e-5])
@pytest.mark.parametrize("outside", [0.0, 1e-6, 1e-3, 0.1])
@pytest.mark.parametrize("seed", range(10))
def test_a_joint_outside_its_limit_comes_back_softly_and_stays(seed, outside, noise):
    """Though it is always asked outward, and measured with noise: never faster inward than the share for a return."""
    rng = np.random.default_rng(seed)
    A = 10.0 ** rng.uniform(0.5, 2.0)
    J, v_max, q_max = A * 10.0 ** rng.uniform(1.0, 1.8), 2.0, 1.5
    q, v, a, ways, speeds = q_max + outside, 0.0, 0.0, [], []
    for _ in range(4000):
        seen = q + noise * rng.uniform(-1.0, 1.0), v + 100.0 * noise * rng.uniform(-1.0, 1.0)
        high = kept_acceleration(*seen, a, q_max, 0.001, v_max, A, J, 2.0 * J, T)
        assert high >= a - 2.0 * J * T - 1e-9
        a = min(high, a + J * T)
        q, v = q + v * T + 0.5 * a * T * T, v + a * T
        ways.append(q - q_max), speeds.append(v)
    assert max(ways) <= outside + 20.0 * noise + 1e-8
    assert min(speeds) >= -(RETURN_SPEED * v_max + 200.0 * noise)
    assert max(ways[-1000:]) <= 50.0 * noise + 1e-4
    assert min(ways[-1000:]) >= -50.0 * noise - 1e-2  # nor is it thrown back
