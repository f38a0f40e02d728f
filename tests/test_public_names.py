"""What a user imports: every public name is documented, loads nothing that it does not need, and fails helpfully."""

import dataclasses
import importlib
import inspect
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from pydrake.systems.framework import Diagram, LeafSystem

import saphari_drake
from saphari_drake.errors import ParameterError
from saphari_drake.estimation import JointVelocity, JointVelocityParameters, TorqueWindow
from saphari_drake.perception import CameraCheck, CameraParameters
from saphari_drake.safety import PowerForceLimit, SpeedSeparation, Supervisor, TorqueChoice, TorqueLimit
from saphari_drake.stations import RobotStation
from saphari_drake.stations.shared import open_link

ROOT = Path(saphari_drake.__file__).parent
PACKAGES = sorted(
    ".".join(("saphari_drake", *path.relative_to(ROOT).parts[:-1])) for path in ROOT.rglob("__init__.pyi")
)
NAMES = [(package, name) for package in PACKAGES for name in importlib.import_module(package).__all__]
# Cases of scripts whose diagrams together hold every system.
DIAGRAMS = {
    "contact_force": "drift",
    "contact_impedance": "natural",
    "nmpc_mobile_manipulator": "human_seen",
    "null_space_ball": "momentum",
    "reverse_priority_planar": "three_level",
    "skin_hand_guiding": "body_first",
}


def public(package: str, name: str):
    return getattr(importlib.import_module(package), name)


def leaf_systems() -> list[type]:
    found = {public(*name) for name in NAMES}
    return [value for value in found if inspect.isclass(value) and issubclass(value, LeafSystem)]


def parameters() -> list[type]:
    found = {public(*name) for name in NAMES}
    return [value for value in found if dataclasses.is_dataclass(value) and value.__name__.endswith("Parameters")]


@pytest.mark.parametrize(("package", "name"), NAMES, ids=".".join)
def test_a_public_name_is_documented(package, name):
    value = public(package, name)
    assert value.__module__.startswith("saphari_drake.")
    assert value.__doc__ and not value.__doc__.startswith(f"{name}("), "a docstring that a dataclass made by itself"


def ports_told(docstring: str, kind: str) -> list[str]:
    """Return the ports of a docstring's system block."""
    block = re.search(rf"{kind}_ports:\n((?:\s+- \w+\n?)*)", docstring)
    return re.findall(r"- (\w+)", block[1]) if block else []


def systems_of(diagram: Diagram):
    for system in diagram.GetSystems():
        if isinstance(system, Diagram):
            yield from systems_of(system)
        elif isinstance(system, LeafSystem):
            kinds = (kind for kind in type(system).__mro__ if kind.__module__.startswith("saphari_drake."))
            yield from ((kind, system) for kind in list(kinds)[:1])


@pytest.fixture(scope="module")
def systems() -> dict[type, LeafSystem]:
    """Return one system of each class of this library, out of the experiments' diagrams."""
    robot = saphari_drake.lwr4()
    found = {CameraCheck: CameraCheck(robot, CameraParameters()), TorqueLimit: TorqueLimit(robot, 0.005)}
    found |= {SpeedSeparation: SpeedSeparation(robot), PowerForceLimit: PowerForceLimit(robot)}
    found |= {Supervisor: Supervisor(), TorqueChoice: TorqueChoice(robot.n)}
    found[TorqueWindow] = TorqueWindow(robot.n, 0.001, 0.005, differenced=True)
    link = open_link(robot.n)
    link.path.unlink()
    found[RobotStation] = RobotStation(robot, link)
    found[JointVelocity] = JointVelocity(robot, JointVelocityParameters(resolution=1e-4))
    for script, case in DIAGRAMS.items():
        experiment = importlib.import_module(script).EXPERIMENT
        found |= dict(systems_of(experiment.build_diagram(experiment.scenario_for(case))))
    return found


def test_port_blocks_tell_the_ports(systems):
    """A class's block names the ports that its instances have, in their order, and the text says what each holds."""
    astray = []
    for kind, system in systems.items():
        told, name = inspect.getdoc(kind), kind.__name__
        inputs = [system.get_input_port(i).get_name() for i in range(system.num_input_ports())]
        outputs = [system.get_output_port(i).get_name() for i in range(system.num_output_ports())]
        if "(each name" in told:
            continue
        # Ports beyond those of this instance are told to exist "only" in some case.
        more = len(ports_told(told, "output")) > len(outputs) and " only" in told.lower()
        outputs_told = ports_told(told, "output")[: len(outputs)] if more else ports_told(told, "output")
        if (ports_told(told, "input"), outputs_told) != (inputs, outputs):
            astray.append(f"{name}: has {inputs} and {outputs}")
        described = re.findall(r"^([\w, ]+?)(?: \(\w+\))? : ", told, re.MULTILINE)
        described = {port for line in described for port in line.split(", ")}
        astray += [f"{name}: {port} is not described" for port in inputs + outputs if port not in described]
    assert astray == []


def test_no_public_system_is_left_out(systems):
    """The test above sees every system that a user can import."""
    assert set(leaf_systems()) <= set(systems)


@pytest.mark.parametrize("kind", parameters(), ids=lambda kind: kind.__name__)
def test_parameters_name_the_field_that_is_wrong(kind):
    """Not a number is no value for any number."""
    for field in dataclasses.fields(kind):
        if isinstance(value := getattr(kind(), field.name), float) and not np.isnan(value):
            with pytest.raises(ParameterError, match=field.name):
                kind(**{field.name: np.nan})


@pytest.mark.parametrize("kind", parameters(), ids=lambda kind: kind.__name__)
def test_parameters_read_well_at_a_prompt(kind):
    assert repr(kind()).startswith(kind.__name__)


def test_a_robot_reads_well_at_a_prompt():
    told = repr(saphari_drake.lwr4())
    assert "'lwr4', 7 joints" in told
    assert "joint_1: -2.97 … 2.97, speed 1.92, torque 176" in told


def test_a_name_that_does_not_exist_is_told():
    with pytest.raises(ImportError, match="ContactImpedanceControler"):
        exec("from saphari_drake.control import ContactImpedanceControler")


def loaded(code: str) -> set[str]:
    """Return the modules that a new interpreter holds after `code`."""
    text = subprocess.run(
        [sys.executable, "-c", f"{code}\nimport sys\nprint(*sys.modules)"], capture_output=True, text=True, check=True
    )
    return set(text.stdout.split())


def test_importing_the_library_loads_no_drake():
    modules = loaded("import saphari_drake, saphari_drake.control, saphari_drake.perception")
    assert not [name for name in modules if name.split(".")[0] in ("pydrake", "numba", "open3d", "matplotlib")]


def test_a_null_space_user_loads_no_camera():
    modules = loaded("from saphari_drake.control import NullSpaceComplianceController")
    assert "saphari_drake.control.null_space.system" in modules
    assert not [name for name in modules if name.startswith(("saphari_drake.perception", "open3d"))]
    assert not [name for name in modules if name.startswith("saphari_drake.control.nmpc")]
