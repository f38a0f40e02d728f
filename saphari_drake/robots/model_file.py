"""What Drake does not keep of a model file, does not find, or mends without stopping: limits, packages, inertias."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np

from saphari_drake.errors import ModelError

_ADDRESS, _PACKAGE = re.compile(r"package://([^/\"'<>]+)/"), re.compile(r"<name>\s*([^<\s]+)\s*</name>")
_MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


def urdf_effort_limits(path: Path) -> dict[str, float]:
    """Return the effort limits of a URDF's joints; Drake keeps them only where there is a transmission."""
    if path.suffix.lower() not in (".urdf", ".xml"):
        return {}
    limits = ((joint.get("name", ""), joint.find("limit")) for joint in ElementTree.parse(path).getroot().iter("joint"))
    return {name: float(limit.get("effort", "inf")) for name, limit in limits if limit is not None}


def packages_above(path: Path) -> dict[str, Path]:
    """Return the folder of each package that a model file names, where one of the folders above the file is it.

    As ROS finds them: a folder of that name, or one whose package.xml has that name.
    """
    folders = path.resolve().parents
    found = {}
    for name in dict.fromkeys(_ADDRESS.findall(path.read_text(encoding="utf-8", errors="replace"))):
        places = [place for folder in folders for place in (folder, folder / name) if _is_package(place, name)]
        if places:
            found[name] = places[0]
    return found


def _is_package(folder: Path, name: str) -> bool:
    manifest = folder / "package.xml"
    text = manifest.read_text(encoding="utf-8", errors="replace") if manifest.is_file() else ""
    return folder.is_dir() and (folder.name == name or name in _PACKAGE.findall(text))


def require_physical_inertias(path: Path) -> None:
    """Refuse a URDF or SDF with a negative mass or an inertia that no body can have.

    Drake replaces such an inertia by that of a ball of water and only warns: a controller would then compute with
    dynamics that are in no file.

    Raises
    ------
    ModelError
        Naming the link and what is wrong.
    """
    for link in ElementTree.parse(path).getroot().iter("link"):
        inertial = link.find("inertial")
        mass = _number(inertial, "mass")
        if mass is None:
            continue
        name = link.get("name", "")
        if not mass >= 0.0:
            raise ModelError(f"{path}: link '{name}' has mass {mass}")
        given = inertial.find("inertia") if inertial is not None else None
        moments = [_number(given, moment) or 0.0 for moment in _MOMENTS]
        xx, xy, xz, yy, yz, zz = moments
        if given is None or not any(moments):
            continue
        least, middle, largest = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        if least < -1e-12 * largest or least + middle < largest * (1.0 - 1e-6):
            principal = ", ".join(f"{value:.3g}" for value in (least, middle, largest))
            raise ModelError(f"{path}: link '{name}' has an inertia that no body has (principal moments {principal})")


def _number(parent: ElementTree.Element | None, tag: str) -> float | None:
    """Value of ``<tag value="…"/>`` or attribute `tag` (URDF), or of ``<tag>…</tag>`` (SDF); None without it."""
    if parent is None:
        return None
    child = parent.find(tag)
    text = parent.get(tag) if child is None else child.get("value", child.text)
    return None if text is None else float(text)
