"""What a script loads: no camera, and nothing of Open3D, where no camera is in the experiment."""

import subprocess
import sys
from pathlib import Path

import pytest

DIAGRAMS = Path(__file__).parents[1] / "diagrams"
WITHOUT_CAMERA = (
    "null_space_ball",
    "null_space_robustness",
    "null_space_wall",
    "reverse_priority_planar",
    "skin_hand_guiding",
)
PROGRAM = """
import importlib, sys
script = importlib.import_module(sys.argv[1])
script.build_diagram(script.scenario_for(next(iter(script.CASES))))
print(*(name for name in sys.modules if "camera" in name or name.partition(".")[0] in ("open3d", "open3d_cpu")))
"""


def loaded(name):
    """Return the modules of cameras that a process holds which imported a script and built its first case."""
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, name], cwd=DIAGRAMS, capture_output=True, text=True, check=True
    )
    return done.stdout.split()


@pytest.mark.parametrize("name", WITHOUT_CAMERA)
def test_a_script_without_a_camera_loads_none(name):
    assert loaded(name) == []


def test_a_script_with_a_camera_loads_it():
    """What the others are looked at by is seen here."""
    assert "saphari_drake.perception.camera.model" in loaded("contact_impedance")
