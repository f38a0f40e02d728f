"""The cell of Section 5: a short run, joint friction and payload."""

import numpy as np
import pytest
from experiments.null_space.cell import NullSpaceCellParameters, ObstacleCellParameters, add_null_space_cell
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from saphari_drake.errors import UnknownNameError


def test_an_unknown_obstacle_is_named():
    with pytest.raises(UnknownNameError, match="ball, wall, nothing"):
        ObstacleCellParameters(obstacle="door")


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
