"""The fit of bells of pressure: its normal equations against finite differences of its cost."""

import numpy as np
import pytest

from saphari_drake.perception.skin import fit
from saphari_drake.perception.skin.bell import Grid, bell_share

GRID = Grid(0.01 * np.arange(-3, 4), 0.01 * np.arange(-2, 3), 0.01)
PRIOR = fit.Prior(np.log(0.012), np.log(0.004), 0.3, 0.2, 0.2, 15)
H = 1e-6


def evaluated(forces, weight, shape, force):
    """Return cost and half the gradient downwards, over shape and force of each bell."""
    bells, count = len(shape), len(forces)
    share, slope = np.empty((bells, count)), np.empty((bells, count, fit.SHAPE))
    for k in range(bells):
        bell_share(GRID, shape[k], share[k], slope[k])
    size = fit.SIZE * bells
    normal, g, load = np.empty((size, size)), np.empty(size), fit.Load(forces, weight)
    fit._normal_equations(load, shape, force, PRIOR, share, slope, normal, g)
    return fit._cost(load, shape, force, PRIOR, share), g.reshape(bells, fit.SIZE)


@pytest.mark.parametrize("bells", [1, 2])
def test_the_step_goes_down_the_gradient_of_the_cost(bells):
    """g = −½∂cost/∂(shape, force), module forces and pulls included; of the pulls' own force it takes no account."""
    rng = np.random.default_rng(bells)
    shape = np.column_stack([rng.uniform(-0.02, 0.02, (bells, 2)), rng.uniform(-4.8, -4.0, (bells, 2)),
                             rng.uniform(-0.4, 0.4, bells)])  # fmt: skip
    force, forces = rng.normal(size=(bells, 3)), 0.1 * rng.normal(size=(35, 3))
    weight = rng.uniform(0.0, 1.0, 35) * (rng.random(35) < 0.8)
    _, g = evaluated(forces, weight, shape, force)
    for k, d in np.ndindex(bells, fit.SHAPE):
        D = np.zeros_like(shape)
        D[k, d] = H
        up, down = (evaluated(forces, weight, shape + sign * D, force)[0] for sign in (1.0, -1.0))
        assert g[k, d] == pytest.approx(-0.5 * (up - down) / (2.0 * H), rel=1e-4, abs=1e-7)
    pulls = np.array([_pull(row) for row in shape])
    for k, d in np.ndindex(bells, 3):
        D = np.zeros_like(force)
        D[k, d] = H
        up, down = (evaluated(forces, weight, shape, force + sign * D)[0] for sign in (1.0, -1.0))
        expected = -0.5 * (up - down) / (2.0 * H) + pulls[k] * force[k, d]
        assert g[k, fit.SHAPE + d] == pytest.approx(expected, rel=1e-4, abs=1e-7)


def _pull(shape):
    """Return how strongly a bell is pulled to the usual one, per square of its force."""
    mean, aspect = 0.5 * (shape[2] + shape[3]) - PRIOR.usual, shape[2] - shape[3]
    return (PRIOR.width * mean) ** 2 + PRIOR.round**2 * (aspect**2 + shape[4] ** 2)
