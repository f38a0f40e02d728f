"""Places of shapes against those of the robot's own kinematics."""

import numpy as np
import pytest
from arms import write_random_tree

from saphari_drake.robots import catalog
from saphari_drake.robots.model import RobotModel
from saphari_drake.safety.verified_stop.geometry import shape_poses
from saphari_drake.safety.verified_stop.parameters import VerifiedStopParameters, body_of


@pytest.mark.parametrize("name", ["lwr4", "omnirob", "tree"])
def test_shapes_are_where_the_links_carry_them(name, tmp_path):
    robot = RobotModel(write_random_tree(tmp_path, 3)) if name == "tree" else catalog.load(name)
    body = body_of(catalog.lwr4() if name == "tree" else robot, VerifiedStopParameters())
    body = body._replace(tree=robot.tree)
    rng, n, s = np.random.default_rng(0), robot.n, len(body.link)
    links, shapes = (np.empty((n, 3, 3)), np.empty((n, 3))), (np.empty((s, 3, 3)), np.empty((s, 3)))
    for _ in range(20):
        q = rng.uniform(-2.0, 2.0, n)
        shape_poses(body, q, links, shapes)
        k = robot.kinematics(q)
        np.testing.assert_allclose(links[0], k.R_WL, atol=1e-12)
        np.testing.assert_allclose(links[1], k.p_WL, atol=1e-12)
        for i, link in enumerate(body.link):
            np.testing.assert_allclose(shapes[0][i], k.R_WL[link] @ body.R_LS[i], atol=1e-12)
            np.testing.assert_allclose(shapes[1][i], k.position(link, body.p_LS[i]), atol=1e-12)
