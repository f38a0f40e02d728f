"""The cell with its sensors and the pipeline, on both interfaces."""

import numpy as np
import pytest
from experiments.guiding.cell import GuidingCellParameters, add_guiding_cell
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from saphari_drake.control.hand_guiding.touch import GuidingPriority
from saphari_drake.errors import ParameterError
from saphari_drake.parameters import validate
from saphari_drake.perception.skin.layout import SkinLayout
from saphari_drake.pipelines.hand_guiding import HandGuidingPipelineParameters
from saphari_drake.robots import catalog
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.simulation.people.guiding_hands import Grip, Hand, Pull

HOME = np.deg2rad([90.0, -35.0, 0.0, 68.0, 0.0, -45.0, 0.0])


@pytest.mark.parametrize("interface", ["torque", "position"])
def test_the_cell_guides_through_its_sensors(interface):
    """Through skin and wrist sensor with bias and noise: both points go where they are led, on either interface."""
    robot = catalog.lwr4()
    robot.home = HOME
    params = GuidingCellParameters(interface=interface)
    params.pipeline.controller.feedback = "commanded" if interface == "position" else "measured"
    layout = SkinLayout(robot, params.skin_layout)
    p = layout.surface([0.005, -0.005])[0]
    n_W = evaluate_dynamics(robot, HOME, np.zeros(7)).R_WL[2] @ np.array([0.0, 1.0, 0.0])
    grips = [
        Grip(6, np.array([0.0, 0.0, 0.12]), Hand([Pull(0.2, 2.0, 0.2, [5.0, 0.0, 3.0])])),
        Grip(2, p, Hand([Pull(0.6, 2.0, 0.2, (-6.0 * n_W).tolist())])),
    ]
    builder = DiagramBuilder()
    cell = add_guiding_cell(builder, robot, grips, params, layout)
    diagram = builder.Build()
    simulator = Simulator(diagram)
    simulator.AdvanceTo(1.2)
    root = simulator.get_context()

    def read(system, name):
        return system.GetOutputPort(name).Eval(system.GetMyContextFromRoot(root))

    truth = read(cell.hands, "truth").reshape(2, 9)
    ideal = np.array([5.0, 0.0, 3.0]) / 30.0 * (1.0 - np.exp(-0.85 / (5.0 / 30.0)))
    np.testing.assert_allclose(truth[0, 6:], ideal, atol=0.012)
    assert truth[1, 6:] @ -n_W > 0.01
    assert read(cell.pipeline.controller, "priority")[0] == GuidingPriority.END_EFFECTOR
    np.testing.assert_allclose(read(cell.pipeline.controller, "force")[3:], truth[1, :3], atol=0.3)


def test_all_parts_take_the_period_of_the_pipeline():
    """Before and after; one of their own is refused."""
    params = GuidingCellParameters(pipeline=HandGuidingPipelineParameters(period=0.004))
    parts = (params.servo, params.joint_sensor, params.skin_sensor, params.force_sensor)
    pipeline = (params.pipeline.skin, params.pipeline.wrist, params.pipeline.controller)
    assert {part.period for part in parts + pipeline} == {0.004}
    params.pipeline.period = 0.002
    validate(params)
    assert {part.period for part in parts + pipeline} == {0.002}
    params.pipeline.controller.period = 0.001
    with pytest.raises(ParameterError, match="controller.period: is that of the pipeline"):
        validate(params)
    with pytest.raises(ParameterError, match="period"):
        HandGuidingPipelineParameters(period=0.05)  # too long for the gains
