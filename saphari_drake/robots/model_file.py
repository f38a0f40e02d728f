"""What Drake does not keep of a model file, or mends without stopping: a second look at the XML."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import NamedTuple

import numpy as np

from saphari_drake.errors import ModelError

_MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


class Mimic(NamedTuple):
    """A joint that follows another: q = multiplier · q_leader + offset."""

    leader: str
    multiplier: float
    offset: float


class FileFacts(NamedTuple):
    """What a file says of its joints, by their names.

    Attributes
    ----------
    effort : dict
        Limits of a URDF (Nm or N); Drake keeps them only where there is a transmission.
    coulomb : dict
        Dry friction (Nm or N), which Drake's plant does not have.
    mimic : dict
        Joints that follow others.
    """

    effort: dict[str, float]
    coulomb: dict[str, float]
    mimic: dict[str, Mimic]


def read_facts(path: Path) -> FileFacts:
    """Read a URDF, SDF or MJCF; nothing of a file that is none of these, or no XML.

    Raises
    ------
    ModelError
        If a joint's lower limit is above its upper one, which would end the process, or an inertia is none: see
        `require_physical_inertias`.
    """
    facts = FileFacts({}, {}, {})
    root = model_tree(path)
    if root is None:
        return facts
    for joint in root.iterfind("joint") if root.tag == "robot" else root.iter("joint"):
        name = joint.get("name")
        if name is None:
            continue
        axis = joint.find("axis")
        holder = joint if axis is None or axis.find("xyz") is None else axis  # of an SDF, the axis holds it
        limit, dynamics, mimic = (holder.find(tag) for tag in ("limit", "dynamics", "mimic"))
        low, high = _number(limit, "lower"), _number(limit, "upper")
        if low is not None and high is not None and low > high:
            raise ModelError(f"{path}: joint '{name}' has its lower limit {low:g} above its upper one {high:g}")
        if root.tag == "robot" and limit is not None:
            effort = _number(limit, "effort")
            facts.effort[name] = np.inf if effort is None else effort
        friction = _number(joint, "frictionloss") if root.tag == "mujoco" else _number(dynamics, "friction")
        facts.coulomb[name] = friction or 0.0
        if mimic is not None:
            numbers = (_number(mimic, key) for key in ("multiplier", "offset"))
            multiplier, offset = (default if x is None else x for x, default in zip(numbers, (1.0, 0.0)))
            facts.mimic[name] = Mimic(mimic.get("joint", ""), multiplier, offset)
    for pair in root.iterfind("equality/joint"):
        facts.mimic[pair.get("joint1", "")] = Mimic(pair.get("joint2", ""), 1.0, 0.0)
    _require_physical_inertias(path, root)
    return facts


def model_tree(path: Path) -> ElementTree.Element | None:
    """Return the root of a model file; prefixes that it does not declare, as Drake's own tags in SDF, are allowed.

    None if it is no XML, which Drake tells better.
    """
    try:
        text = path.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return None
    text = re.sub(r"^\s*<\?xml[^>]*\?>", "", text)
    used = set(re.findall(r"[<\s/]([A-Za-z_][\w.-]*):[A-Za-z_]", text)) - {"xmlns", "xml"}
    lacking = used - set(re.findall(r"xmlns:([\w.-]+)\s*=", text))
    declared = "".join(f' xmlns:{prefix}="{prefix}"' for prefix in sorted(lacking))
    try:
        return ElementTree.fromstring(re.sub(r"<(robot|sdf|mujoco)\b", rf"<\1{declared}", text, count=1))
    except ElementTree.ParseError:
        return None


def _require_physical_inertias(path: Path, root: ElementTree.Element) -> None:
    """Refuse a URDF or SDF with a negative mass or an inertia that no body can have.

    Drake replaces such an inertia by that of a ball of water and only warns: a controller would then compute with
    dynamics that are in no file.

    Raises
    ------
    ModelError
        Naming the link and what is wrong.
    """
    for link in root.iter("link"):
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
    try:
        return None if text is None else float(text)
    except ValueError:
        return None  # Drake tells it, or does not need it
