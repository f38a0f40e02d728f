"""diagrams/contact_alone.py, briefly: a model that is wrong, nobody near, and a camera that is lost."""

import contact_alone
import numpy as np
import pytest
from measured_loop import contact_loop, see
from pydrake.multibody.tree import SpatialInertia

from saphari_drake.messages import InteractionMode
from saphari_drake.pipelines.contact import ContactPipelineParameters
from saphari_drake.simulation.runner.simulation import RunOptions


@pytest.mark.parametrize("case", ["tool", "blind"])
def test_the_arm_stays_and_feels_nobody(case):
    scenario = contact_alone.scenario_for(case)
    scenario.duration, scenario.fault_time = 2.5, 0.5
    outcome = contact_alone.run(scenario, RunOptions())
    missed = [m.name for m in outcome.metrics if m.decides and not m.low <= m.value <= m.high]
    assert missed == []


@pytest.mark.parametrize("scale", [0.95, 1.05])
def test_all_links_off_together_and_a_tool_with_and_without_a_camera(lwr4, scale):
    """The worst that the prior allows for: every link by 5 % in the same direction, and 0.5 kg on the last one."""
    params = ContactPipelineParameters()
    params.observer.gain = 150.0
    loop = contact_loop(lwr4.with_home(np.deg2rad([90.0, -30.0, 0.0, 60.0, 0.0, -90.0, 0.0])), params)
    context = loop.plant.GetMyMutableContextFromRoot(loop.context)
    for name in lwr4.link_names:
        body = loop.plant.GetBodyByName(name)
        own = body.CalcSpatialInertiaInBodyFrame(context)
        changed = SpatialInertia(scale * own.get_mass(), own.get_com(), own.get_unit_inertia())
        if name == lwr4.link_names[-1]:
            changed += SpatialInertia.SolidSphereWithMass(0.5, 0.04).Shift([0.0, 0.0, -0.05])
        body.SetSpatialInertiaInBodyFrame(context, changed)
    start, ways, felt = loop.wrist, [], []
    for _ in range(30):
        loop.run(50, see if loop.steps < 700 else lambda loop: None)
        ways.append(np.linalg.norm(loop.wrist - start))
        felt.append(loop.read(loop.pipeline.detector, "contact")[0])
    assert max(ways) < 0.005 and max(felt) == 0.0
    assert loop.read(loop.pipeline.monitor, "mode")[0] == InteractionMode.STOP
    assert ways[-1] < 0.001
