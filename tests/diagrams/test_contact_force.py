"""diagrams/contact_force.py from the command line, and the parameters that it adds to a push."""

import importlib.util
import sys
from pathlib import Path

import pytest
from pydrake.common.yaml import yaml_dump_typed, yaml_load_typed

from saphari_drake.control.contact.force_system import ContactForceController
from saphari_drake.simulation.people.pushing_hand import Push
from saphari_drake.simulation.runner.experiment import main

SCRIPT = Path(__file__).parents[2] / "diagrams" / "contact_force.py"


@pytest.fixture(scope="module")
def script():
    spec = importlib.util.spec_from_file_location("contact_force", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    sys.modules["contact_force"] = module
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    "arguments, words",
    [
        (["--case", "drifting"], ["drifting", "drift, compatible"]),
        (["--set", "system.pipeline.controller.direction=up"], ["direction", "up", "aligned, fixed"]),
        (["--set", "system.pipeline.controller.gate_off=5"], ["gate_off", "gate_on"]),
        (["--set", "system.pipeline.controller.K_p=5"], ["K_p", "K_f"]),
        (["--set", "system.pipeline.controller.period=0.01"], ["controller.period", "set period"]),
    ],
)
def test_bad_input_is_one_line_and_status_2(script, capsys, arguments, words):
    assert main(script.EXPERIMENT, arguments) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    for word in words:
        assert word in lines[0]


@pytest.mark.parametrize("case", ["drift", "compatible"])
def test_scenarios_load_with_drake_s_own_loader(script, case):
    """The kind of the controller is kept."""
    text = yaml_dump_typed(script.scenario_for(case))
    loaded = yaml_load_typed(schema=script.ContactForceScenario, data=text)
    assert yaml_dump_typed(loaded) == text
    assert type(loaded.system.pipeline.controller) is type(script.scenario_for(case).system.pipeline.controller)


def test_the_diagram_holds_the_force_controller(script):
    setup = script.build(script.scenario_for("drift"))
    assert isinstance(setup.parts.pipeline.controller, ContactForceController)
    setup.diagram.CreateDefaultContext()


@pytest.mark.parametrize("field", ["depth", "speed", "stiffness", "damping"])
def test_push_refuses_negative_values(field):
    with pytest.raises(ValueError, match=field):
        Push(**{field: -1.0})
