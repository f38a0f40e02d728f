"""What cameras see of people: their segments, sampled."""

import numpy as np
from bench import Bench
from pydrake.systems.framework import DiagramBuilder

from saphari_drake.simulation.people.compliant_people import COUNT, CompliantPeople
from saphari_drake.simulation.people.performance import PerformanceParameters, performance
from saphari_drake.simulation.people.shown_people import ShownPeople
from saphari_drake.simulation.people.skeleton import PersonSizes
from saphari_drake.simulation.world.cell import add_cell


def test_people_are_seen_where_their_segments_were_at_the_last_sample(lwr4):
    cell = add_cell(DiagramBuilder(), lwr4)
    person = performance(PerformanceParameters(), PersonSizes())
    shown = ShownPeople(cell.scene_graph, CompliantPeople(lwr4, cell.plant, cell.instance, [person]))
    before, after = np.random.default_rng(0).uniform(-1.0, 1.0, (2, COUNT, 2, 3))
    b = Bench(shown, ends=before.ravel())

    def check(ends):
        poses = b.read("geometry_pose")
        for frame, (p, q) in zip(shown._frames, ends):
            pose = poses.value(frame)
            np.testing.assert_allclose(pose.translation(), 0.5 * (p + q), atol=1e-12)
            along = pose.rotation().col(2)
            np.testing.assert_allclose(along, (q - p) / np.linalg.norm(q - p), atol=1e-12)

    check(before)
    b.set(ends=after.ravel())
    check(before)
    b.run(3)
    check(after)
