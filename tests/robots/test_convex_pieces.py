"""Primitives contain the body that they stand for, and lie near it."""

import numpy as np
import pytest

from saphari_drake.math.primitives import BOX, surface_point
from saphari_drake.robots.convex_pieces import NEAR, convex_pieces

RING = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)


def prism(radii, heights, turn):
    """A tube about z of these radii at these heights, as vertices and faces, turned."""
    rows = [np.column_stack([r * np.cos(RING), r * np.sin(RING), np.full(24, z)]) for r, z in zip(radii, heights)]
    faces = [list(range(24)), list(range(24 * (len(radii) - 1), 24 * len(radii)))]
    for k in range(len(radii) - 1):
        faces += [[24 * k + i, 24 * k + (i + 1) % 24, 24 * k + 24 + (i + 1) % 24, 24 * k + 24 + i] for i in range(24)]
    return np.concatenate(rows) @ turn.T, faces


BLOCK = np.array([[x, y, z] for x in (0, 0.1) for y in (0, 0.2) for z in (0, 0.3)])
BLOCK_FACES = [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]]
TURN = np.linalg.qr(np.array([[1.0, 2, 3], [0, 1, 4], [5, 6, 0]]))[0]


@pytest.mark.parametrize(
    "body",
    [(BLOCK @ TURN.T, BLOCK_FACES), prism([0.05, 0.05], [0.0, 0.3], TURN), prism([0.08, 0.04], [0.0, 0.4], TURN)],
    ids=["box", "cylinder", "cone"],
)
def test_primitives_contain_the_body_and_lie_near_it(body):
    vertices, faces = body
    pieces = convex_pieces(vertices, faces)
    middles = np.array([vertices[face].mean(axis=0) for face in faces])

    def depth(points):
        inside = [[surface_point(p.kind, np.array(p.size), p.R, p.p, point)[0] for p in pieces] for point in points]
        return -np.min(inside, axis=1)

    assert depth(vertices).min() > -1e-9
    assert depth(middles).mean() < 2.0 * NEAR


def test_a_box_is_one_box():
    (piece,) = convex_pieces(BLOCK @ TURN.T, BLOCK_FACES)
    assert piece.kind == BOX
    np.testing.assert_allclose(sorted(piece.size), [0.05, 0.1, 0.15], atol=1e-9)
