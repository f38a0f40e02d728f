"""Ball and wall beside the arm: their stiffness, and the way of the ball."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from saphari_drake.simulation.world.cell import add_cell
from saphari_drake.simulation.world.obstacles import Ball, BallParameters, Wall, WallParameters, ball_path
from saphari_drake.simulation.world.plant import PlantParameters


@pytest.mark.parametrize("obstacle", ["ball", "wall"])
def test_stiffness_of_the_obstacles(lwr4, obstacle):
    """Pressed by a known depth at rest, ball and pad push with stiffness times depth."""
    ball, wall = BallParameters(dissipation=0.0), WallParameters(dissipation=0.0, gap=1e-12)
    depth, step = 0.01, 1e-5
    builder = DiagramBuilder()
    body = Ball(ball) if obstacle == "ball" else Wall(wall)
    cell = add_cell(builder, lwr4, [body], PlantParameters(time_step=step, rigid_cover=True))
    builder.ExportInput(cell.torque_input, "torque")
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    diagram.get_input_port(0).FixValue(context, np.zeros(7))
    plant = cell.plant
    own = plant.GetMyMutableContextFromRoot(context)
    if obstacle == "ball":
        plant.SetPositions(own, plant.GetModelInstanceByName("ball"), [ball.gap + depth])
        stiffness = ball.stiffness
    else:
        q = lwr4.home.copy()
        q[0] += 0.05
        plant.SetPositions(own, cell.instance, q)
        stiffness, depth = wall.stiffness, None
    Simulator(diagram, context).AdvanceTo(step)  # results are those of the last step
    results = cell.contact_results.Eval(own)
    assert results.num_point_pair_contacts() == 1
    info = results.point_pair_contact_info(0)
    measured = abs(info.contact_force() @ info.point_pair().nhat_BA_W)
    deep = info.point_pair().depth
    if depth is not None:
        assert deep == pytest.approx(depth, abs=1e-6)
    assert measured == pytest.approx(stiffness * deep, rel=0.01)


def test_travel_of_the_ball():
    """The ball reaches its stroke at its speed, dwells, returns at the same speed, and stays away."""
    p = BallParameters()
    path, reach = ball_path(p), p.gap + p.stroke
    speed = path.MakeDerivative()
    for time, travel, rate in (
        (0.5 * p.start, 0.0, 0.0),
        (p.start + 0.1, 0.1 * p.speed, p.speed),
        (p.arrival - 1e-9, reach, p.speed),
        (p.arrival + 5.0, reach, 0.0),
        (p.departure + 0.1, reach - 0.1 * p.speed, -p.speed),
        (p.departure + 60.0, 0.0, 0.0),
    ):
        assert path.value(time)[0, 0] == pytest.approx(travel, abs=1e-9)
        assert speed.value(time)[0, 0] == pytest.approx(rate, abs=1e-9)
