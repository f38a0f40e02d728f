"""The arm in a URDF, as the experiments take it: one chain of joints, with shapes that collide, are seen and found."""

from __future__ import annotations

import hashlib
import os
import tempfile
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.parsing import PackageMap, Parser
from pydrake.multibody.plant import MultibodyPlant

from saphari_drake.errors import ModelError
from saphari_drake.robots import catalog
from saphari_drake.robots.assembly import add_packages
from saphari_drake.robots.attached import ModelOptions
from saphari_drake.robots.mesh_primitives import fit_capsules, read_triangles
from saphari_drake.robots.model import RobotModel

Element = ElementTree.Element
MOVING = ("revolute", "continuous", "prismatic")
_PAINT = {"name": "arm"}


def load_arm(name_or_path: str, home: ArrayLike = (), options: ModelOptions | None = None) -> RobotModel:
    """Return a shipped robot by its name, or the bare arm of a model file (`arm_file`), as `catalog.load` does."""
    options = options or ModelOptions()
    path = arm_file(Path(name_or_path), options.package_dirs, hold=not options.joints)
    return catalog.load(str(path) if path.is_file() else name_or_path, home=home, options=options)


def arm_file(path: Path, package_dirs: Sequence[str | Path] = (), hold: bool = True) -> Path:
    """Return a URDF of the bare arm in a model file: the file itself where nothing has to change.

    Joints of a gripper (all beyond the first link that carries two chains, and those that mimic another) are held at
    zero. Meshes become capsules (`fit_capsules`), of which the plant, the camera and the controllers then know alike;
    links without collision shapes get theirs from what is drawn, if no link has any. `hold`: whether a gripper is held.

    Raises
    ------
    ModelError
        If a mesh cannot be read.
    """
    if path.suffix.lower() != ".urdf" or not path.is_file():
        return path
    try:
        root = ElementTree.parse(path).getroot()
    except ElementTree.ParseError:
        return path  # the parser of the model tells what is wrong
    held = _gripper(root) if hold else []
    meshes = list(root.iter("mesh"))
    if not held and not meshes:
        return path
    for joint in held:
        joint.set("type", "fixed")
        for child in list(joint):
            if child.tag in ("axis", "limit", "mimic", "dynamics", "safety_controller", "calibration"):
                joint.remove(child)
    fixed = {joint.get("name") for joint in held}
    for transmission in [t for t in root.iter("transmission") if any(j.get("name") in fixed for j in t.iter("joint"))]:
        root.remove(transmission)
    if meshes:
        parser = Parser(MultibodyPlant(0.0))
        add_packages(parser, path, package_dirs)
        _replace_meshes(root, path, parser.package_map())
    return _kept(ElementTree.tostring(root, encoding="unicode"), path)


def _gripper(root: Element) -> list[Element]:
    """The moving joints that are not the arm's."""
    joints = root.findall("joint")
    moving = [joint for joint in joints if joint.get("type") in MOVING]
    below = {_end(joint, "child"): joint for joint in joints}

    def carrier(joint: Element) -> Element | None:
        """The moving joint next below."""
        under = below.get(_end(joint, "parent"))
        while under is not None and under.get("type") not in MOVING:
            under = below.get(_end(under, "parent"))
        return under

    carried: dict[Element | None, list[Element]] = {}
    for joint in moving:
        carried.setdefault(carrier(joint), []).append(joint)
    arm: list[Element] = []
    following = carried.get(None, [])
    while len(following) == 1 and following[0].find("mimic") is None:
        arm += following
        following = carried.get(arm[-1], [])
    return [joint for joint in moving if joint not in arm] if arm else []


def _end(joint: Element, tag: str) -> str:
    element = joint.find(tag)
    return "" if element is None else element.get("link", "")


def _replace_meshes(root: Element, path: Path, packages: PackageMap) -> None:
    drawn = not any(True for _ in root.iter("collision"))
    for link in root.findall("link"):
        sources = link.findall("visual" if drawn else "collision")
        geometries = [shape for source in sources for shape in _shapes(source, path, packages)]
        for old in [*link.findall("visual"), *link.findall("collision")]:
            link.remove(old)
        for origin, geometry in geometries:
            for tag in ("visual", "collision"):
                element = ElementTree.SubElement(link, tag)
                element.extend([origin, geometry])
                if tag == "visual":
                    material = ElementTree.SubElement(element, "material", _PAINT)
                    ElementTree.SubElement(material, "color", {"rgba": "0.55 0.57 0.60 1"})


def _shapes(source: Element, path: Path, packages: PackageMap) -> Iterator[tuple[Element, Element]]:
    """Origin and geometry of what stands for a collision (or visual) element."""
    origin, geometry = source.find("origin"), source.find("geometry")
    if geometry is None:
        return
    mesh = geometry.find("mesh")
    if mesh is None:
        yield ElementTree.Element("origin") if origin is None else origin, geometry
        return
    X_LG = _pose(origin)
    scale = [float(word) for word in mesh.get("scale", "1 1 1").split()]
    triangles = read_triangles(_mesh_path(mesh.get("filename", ""), path, packages)) * scale
    for capsule in fit_capsules(triangles):
        X = X_LG @ RigidTransform(RotationMatrix(capsule.R), capsule.p)
        rpy = RollPitchYaw(X.rotation()).vector()
        words = {"xyz": _words(X.translation()), "rpy": _words(rpy)}
        shape = ElementTree.Element("geometry")
        if capsule.length > 0.0:
            size = {"radius": f"{capsule.radius:.6f}", "length": f"{capsule.length:.6f}"}
            ElementTree.SubElement(shape, "capsule", size)
        else:
            ElementTree.SubElement(shape, "sphere", {"radius": f"{capsule.radius:.6f}"})
        yield ElementTree.Element("origin", words), shape


def _pose(origin: Element | None) -> RigidTransform:
    def numbers(name: str) -> list[float]:
        return [float(word) for word in ("0 0 0" if origin is None else origin.get(name, "0 0 0")).split()]

    return RigidTransform(RollPitchYaw(numbers("rpy")), numbers("xyz"))


def _words(values: np.ndarray) -> str:
    return " ".join(f"{value:.9f}" for value in values)


def _mesh_path(address: str, path: Path, packages: PackageMap) -> Path:
    if address.startswith("package://"):
        name, _, rest = address.removeprefix("package://").partition("/")
        if not packages.Contains(name):
            raise ModelError(f"{path}: no folder above it is the package '{name}' of {address}")
        return Path(packages.GetPath(name)) / rest
    return path.parent / address.removeprefix("file://")


def _kept(text: str, path: Path) -> Path:
    """Write a text below the folder for temporary files, once for each content; return its path."""
    name = hashlib.sha256(text.encode()).hexdigest()[:16]
    folder = Path(tempfile.gettempdir()) / f"saphari_drake-{os.getuid() if hasattr(os, 'getuid') else ''}" / name
    result = folder / path.name
    if not result.is_file():
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile("w", dir=folder, delete=False, encoding="utf-8") as file:
            file.write(text)
        os.replace(file.name, result)
    return result
