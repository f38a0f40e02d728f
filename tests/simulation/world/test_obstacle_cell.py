"""Ball and wall beside the arm: stiffness, motion, friction, payload, and a short run of the whole cell."""

import numpy as np
import pytest
from experiments.null_space.cell import NullSpaceCellParameters, add_null_space_cell
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from saphari_drake.simulation.world.ball_and_wall import BallParameters, ball_travel
from saphari_drake.simulation.world.obstacle_cell import ObstacleCellParameters, add_obstacle_cell
from saphari_drake.simulation.world.references import StraightMotionParameters, straight_motion


@pytest.mark.parametrize("obstacle", ["ball", "wall"])
def test_stiffness_of_the_obstacles(lwr4, obstacle):
    """Pressed by a known depth at rest, ball and pad push with stiffness times depth."""
    params = ObstacleCellParameters(obstacle=obstacle, time_step=1e-5)
    params.ball.dissipation = params.wall.dissipation = 0.0
    depth = 0.01
    if obstacle == "wall":
        params.wall.gap = 1e-12
    builder = DiagramBuilder()
    cell = add_obstacle_cell(builder, lwr4, params)
    builder.ExportInput(cell.torque_input, "torque")
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    diagram.get_input_port(0).FixValue(context, np.zeros(7))
    plant = cell.plant
    own = plant.GetMyMutableContextFromRoot(context)
    if obstacle == "ball":
        plant.SetPositions(own, plant.GetModelInstanceByName("ball"), [params.ball.gap + depth])
        stiffness = params.ball.stiffness
    else:
        q = lwr4.home.copy()
        q[0] += 0.05
        plant.SetPositions(own, cell.instance, q)
        stiffness, depth = params.wall.stiffness, None
    Simulator(diagram, context).AdvanceTo(params.time_step)  # results are those of the last step
    results = plant.get_contact_results_output_port().Eval(own)
    assert results.num_point_pair_contacts() == 1
    info = results.point_pair_contact_info(0)
    measured = abs(info.contact_force() @ info.point_pair().nhat_BA_W)
    deep = info.point_pair().depth
    if depth is not None:
        assert deep == pytest.approx(depth, abs=1e-6)
    assert measured == pytest.approx(stiffness * deep, rel=0.01)


def test_travel_of_ball_and_path():
    """The ball reaches its stroke at its speed, dwells, and returns; the path is smooth and there and back."""
    p = BallParameters()
    assert ball_travel(p, p.start)[0] == 0.0
    assert ball_travel(p, p.arrival + 5.0) == (p.gap + p.stroke, 0.0)
    assert ball_travel(p, p.departure + 60.0) == (0.0, 0.0)
    motion, h = StraightMotionParameters(), 1e-6
    for t in (0.2, 1.0, 3.4, 3.9, 5.0, 8.0):
        s, rate, second = straight_motion(motion, t)
        assert 0.0 <= s <= 1.0
        after, before = straight_motion(motion, t + h), straight_motion(motion, t - h)
        assert rate == pytest.approx((after[0] - before[0]) / (2 * h), abs=1e-6)
        assert second == pytest.approx((after[1] - before[1]) / (2 * h), abs=1e-5)


def test_short_run_in_the_cell(lwr4):
    """Ball on the simulated arm with encoders, at 2 ms: the momentum observer keeps the task within 0.3 mm."""
    params = NullSpaceCellParameters()
    params.cell.ball.start, params.cell.ball.gap = 0.01, 0.002
    builder = DiagramBuilder()
    parts = add_null_space_cell(builder, lwr4, params)
    diagram = builder.Build()
    simulator = Simulator(diagram)
    simulator.AdvanceTo(0.5)
    context = parts.pipeline.controller.GetMyContextFromRoot(simulator.get_context())
    assert np.linalg.norm(parts.pipeline.controller.GetOutputPort("task_error").Eval(context)) < 5e-4
    own = parts.pipeline.momentum.GetMyContextFromRoot(simulator.get_context())
    residual = parts.pipeline.momentum.GetOutputPort("torque_external").Eval(own)
    assert np.abs(residual).max() > 1.0


def test_friction_sticks_and_payload_weighs(lwr4):
    """A joint whose load is below its Coulomb friction stays at rest; the payload adds its weight to what is felt."""
    for payload in (0.0, 1.0):
        params = NullSpaceCellParameters()
        params.cell.obstacle, params.cell.friction_share, params.cell.payload = "nothing", 1.0, payload
        builder = DiagramBuilder()
        parts = add_null_space_cell(builder, lwr4, params)
        diagram = builder.Build()
        simulator = Simulator(diagram)
        simulator.AdvanceTo(0.1)
        state = parts.cell.robot_state.Eval(parts.cell.plant.GetMyContextFromRoot(simulator.get_context()))
        moved = np.abs(state[:7] - lwr4.home).max()
        assert moved < 1e-9 if payload == 0.0 else moved < 1e-4
