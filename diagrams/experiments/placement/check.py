"""What check_robot.py does: a model file, its arm and the experiments, one line each."""

from __future__ import annotations

import argparse
import importlib
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from experiments.evidence.discovery import find_scripts
from experiments.placement.arm import PlacedArm, placed_arm
from saphari_drake.errors import ModelError, SaphariError
from saphari_drake.robots.arm_file import arm_file, load_arm
from saphari_drake.robots.model import RobotModel
from saphari_drake.robots.posture import is_home
from saphari_drake.simulation.runner.command_line import complain, say
from saphari_drake.simulation.runner.other_robot import adapted

ALL, SOME, UNUSABLE = 0, 1, 2
LIGHT = 0.005  # kg m²; a joint with less inertia than this is moved by the noise of its own sensor
EPILOG = """examples:
  python diagrams/check_robot.py my_arm.urdf
  python diagrams/check_robot.py my_arm.urdf --only contact_impedance --build
  python diagrams/contact_impedance.py --model my_arm.urdf      then runs it

What an arm needs: one chain of six or seven revolute joints on a fixed base; a mass and an inertia for each link;
<limit effort="…"/> above zero, lower, upper and velocity for each joint; collision shapes, or meshes of them (.stl,
.obj or .dae, below a package folder above the file), which become capsules. Joints of a gripper are held at zero. A
home posture is found from limits, reach and manipulability. Six joints leave no self-motion while a pose is kept, and
little while a point is.
Exit status: 0 every experiment can run, 1 some cannot (each tells why), 2 the model cannot be used."""


def main(argv: Sequence[str] | None, scripts: Path) -> int:
    """Check the model that the command line names against the experiments in a folder; return the exit status."""
    try:
        options = _parser().parse_args(argv)
        return _checked(options, scripts)
    except (SaphariError, OSError) as error:
        complain("check_robot", error)
        return UNUSABLE


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="check_robot",
        description="Tell what a robot's model file lacks and which experiments its arm can do.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog=EPILOG,
    )
    parser.add_argument("model", type=Path, metavar="MODEL", help="URDF or SDF of the robot")
    parser.add_argument(
        "--only", action="append", default=[], metavar="SCRIPT", help="check this alone; may be repeated"
    )
    parser.add_argument("--build", action="store_true", help="build each diagram too (compiles kernels, some minutes)")
    return parser


def _checked(options: argparse.Namespace, folder: Path) -> int:
    if not options.model.is_file():
        raise ModelError(f"no model file '{options.model}'")
    robot = load_arm(str(options.model))
    say(f"{robot!r}\n")
    for line in (*file_notes(options.model, robot), *model_notes(robot)):
        say(f"- {line}")
    arm = placed_arm(robot)
    say("\n".join(["", *arm_lines(robot, arm), ""]))
    status = ALL
    for can, line in experiment_lines(options.model, folder, options.only, options.build):
        say(line)
        status = status if can else SOME
    return status


def file_notes(path: Path, robot: RobotModel) -> Iterator[str]:
    """Yield what had to be changed of a model file for the experiments."""
    used = arm_file(path)
    if used == path:
        return
    before, after = (ElementTree.parse(each).getroot() for each in (path, used))
    moving = [joint.get("name") for joint in before.findall("joint") if joint.get("type") not in (None, "fixed")]
    held = [name for name in moving if name not in robot.joint_names]
    if held:
        yield f"held at zero, not of the arm's chain: {', '.join(map(str, held))}"
    meshes = sum(1 for link in before.findall("link") for _ in link.iter("mesh"))
    if meshes:
        capsules = sum(1 for each in after.iter("collision") for _ in each.iter("geometry"))
        yield f"{meshes} meshes, of which Drake and the localizer get {capsules} capsules ({used})"


def model_notes(robot: RobotModel) -> Iterator[str]:
    """Yield what a model lacks, or what it makes difficult."""
    for values, what in ((robot.q_max - robot.q_min, "position"), (robot.v_max, "velocity")):
        open_ends = [name for name, value in zip(robot.joint_names, values) if not np.isfinite(value)]
        if open_ends:
            yield f"no {what} limit: {', '.join(open_ends)}"
    bare = [name for k, name in enumerate(robot.link_names) if not np.any(robot.shapes.link == k)]
    if bare:
        yield f"no collision shape, so that nobody can touch it: {', '.join(bare)}"
    if not np.any(robot.tree.armature):
        yield "no rotor inertia (drake:rotor_inertia and drake:gear_ratio): its motors weigh nothing"
    if not is_home(robot):
        yield "no home posture inside its limits: one is found"


def arm_lines(robot: RobotModel, arm: PlacedArm) -> list[str]:
    """Return how the arm is understood."""
    chain, names = arm.chain, robot.joint_names
    inertia = np.diag(arm.terms.M)
    light = [f"{name} {value:.2g}" for name, value in zip(names, inertia) if value < LIGHT]
    load = np.abs(arm.terms.g) / robot.tau_max
    lines = [
        f"shoulder {names[chain.shoulder]}, elbow {names[chain.elbow]}, wrist {names[chain.wrist]}, "
        f"last joint {names[chain.tip]}; reach {chain.reach:.2f} m from shoulder to wrist",
        f"home {arm.home_deg} deg, tip at {np.round(arm.tip, 2).tolist()} m; gravity takes {load.max():.0%} of the "
        f"torque limit of {names[int(load.argmax())]}",
    ]
    return [*lines, f"light joints (kg m² at home): {', '.join(light)}"] if light else lines


def experiment_lines(path: Path, folder: Path, only: Sequence[str], build: bool) -> Iterator[tuple[bool, str]]:
    """Yield, for each case of each script that takes another arm, whether this one can do it, and a line."""
    for name in find_scripts(folder):
        if only and name not in only:
            continue
        module = importlib.import_module(name)
        experiment = module.EXPERIMENT
        if experiment.adapt is None:
            continue
        lines: dict[str, list[str]] = {}
        for case in experiment.others:
            try:
                scenario = adapted(experiment, experiment.scenario_for(case), str(path))
                if build:
                    experiment.build_diagram(scenario)
                lines.setdefault("", []).append(case)
            except SaphariError as error:
                lines.setdefault(" ".join(str(error).split()), []).append(case)
        for reason, cases in lines.items():
            yield not reason, f"{name}: {', '.join(cases)}: {reason or 'can run'}"
