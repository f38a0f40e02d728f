"""What a run of the safe cell was worth, by the simulated truth: limits, contacts, job."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from experiments.cell.build import SafeCellRig
from saphari_drake.math.products import cholesky
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.safety.nearness import posed, surface_of, towards
from saphari_drake.safety.power_force.law import Rule, contact_mass, effective_mass, is_clamped
from saphari_drake.safety.power_force.parameters import walls_of
from saphari_drake.safety.power_force.regions import BodyRegion, limits_of, read_regions
from saphari_drake.safety.supervisor.law import CellState
from saphari_drake.simulation.people.skeleton import SEGMENTS
from saphari_drake.simulation.record.log import Log

Array = NDArray[np.float64]
APART = 0.05  # s; a contact that begins sooner after the last one is the same
_JOB = (CellState.FREE, CellState.SLOWED)


@dataclass(frozen=True)
class Hit:
    """A contact, as it began, and the largest force of it.

    Attributes
    ----------
    time : float
        s.
    segment : str
        Of the person.
    energy : float
        J, ½ μ v_r² of the robot's own speed towards the person, as `contact_scale` has it.
    limit : float
        J, that the region may have.
    clamped : bool
    force, force_limit : float
        N, largest, and what the region may have.
    """

    time: float
    segment: str
    energy: float
    limit: float
    clamped: bool
    force: float
    force_limit: float


@dataclass(frozen=True)
class CellRun:
    """A finished run."""

    rig: SafeCellRig
    way: str
    trial: int
    fast: Log
    slow: Log
    wall: float  # s
    hits: list[Hit]

    @property
    def job_time(self) -> float:
        """When the job was done (s); infinite if it was not."""
        done = np.flatnonzero(self.slow["progress"][:, 0] >= self.rig.scenario.job_time - 1e-6)
        return float(self.slow.time[done[0]]) if done.size else np.inf

    @property
    def job_time_at_least(self) -> float:
        """The same, or of a job that was not done the time of the run stretched to all of it."""
        if np.isfinite(self.job_time):
            return self.job_time
        share = max(float(self.slow["progress"][-1, 0]), 1e-3) / self.rig.scenario.job_time
        return float(self.slow.time[-1]) / share

    @property
    def stops(self) -> int:
        """How often the job was stopped."""
        state = self.fast["state"][:, 0].astype(int)
        works = np.isin(state, _JOB)
        return int(np.sum(works[:-1] & ~works[1:]))

    @property
    def violations(self) -> int:
        """Samples of 1 ms at which a joint left a limit of torque, speed or position."""
        robot, log = self.rig.robot, self.fast
        margin = 1.0 + 1e-6
        bad = np.any(np.abs(log["torque"]) > margin * robot.tau_max, axis=1)
        bad |= np.any(np.abs(log["velocity"]) > margin * robot.v_max, axis=1)
        bad |= np.any((log["position"] > robot.q_max + 1e-6) | (log["position"] < robot.q_min - 1e-6), axis=1)
        return int(bad.sum())

    @property
    def energy_share(self) -> float:
        """Largest energy of a contact over what its region may have; 0 without contacts."""
        return max((hit.energy / hit.limit for hit in self.hits), default=0.0)

    @property
    def force_share(self) -> float:
        """Largest force of a contact over what its region may have; also that which a person brings along."""
        return max((hit.force / hit.force_limit for hit in self.hits), default=0.0)

    @property
    def torque_step(self) -> float:
        """Largest change of a joint's torque within 1 ms where the state changes, as a share of its limit."""
        changes = np.flatnonzero(np.diff(self.fast["state"][:, 0]) != 0.0)
        if changes.size == 0:
            return 0.0
        near = np.unique(np.clip(changes[:, None] + np.arange(-1, 4), 0, len(self.fast.time) - 2))
        steps = np.abs(np.diff(self.fast["torque"], axis=0)) / self.rig.robot.tau_max
        return float(steps[near].max())


def hits_of(rig: SafeCellRig, fast: Log) -> list[Hit]:
    """Return the contacts of a run."""
    touch, regions = fast["touch"], read_regions()
    felt = touch[:, 7] >= 0.0
    step = fast.time[1] - fast.time[0]
    hits, last = [], -np.inf
    for k in np.flatnonzero(felt):
        now, region = fast.time[k], SEGMENTS[int(touch[k, 7]) % len(SEGMENTS)].region
        new, last = now - last > APART, now
        if new:
            end = k + int(np.argmin(felt[k:])) if not felt[k:].all() else len(felt)
            force = float(np.linalg.norm(touch[k : max(end, k + round(APART / step)), :3], axis=1).max())
            hits.append(_hit(rig, fast, int(k), regions[region], force))
    return hits


def _hit(rig: SafeCellRig, fast: Log, k: int, region: BodyRegion, force: float) -> Hit:
    """Return a contact that begins with sample k, from the state before it."""
    robot, touch = rig.robot, fast["touch"][k]
    before = max(k - 1, 0)
    terms = evaluate_dynamics(robot, fast["position"][before], fast["velocity"][before])
    u, link = -touch[:3] / np.linalg.norm(touch[:3]), int(touch[6])
    row, L = np.empty(robot.n), np.empty((robot.n, robot.n))
    towards(terms.motion, link, touch[3:6], u, row)
    cholesky(terms.M, L)
    p = rig.scenario.pipeline.force_limit
    surface = surface_of(robot)
    rule = Rule(limits_of({"": region}, [""]), walls_of(p.structures), p.reach, p.clamp_gap, p.thickest, p.still)
    shape = int(np.flatnonzero(surface.link == link)[0])
    clamped = is_clamped(surface, posed(surface, terms.motion), shape, touch[3:6], u, region.thickness, rule)
    closing = max(float(row @ fast["velocity"][before]), 0.0)
    mass = contact_mass(effective_mass(L, row), region.mass, clamped)
    head = region.transient == 0.0
    limit = region.force**2 / (2.0 * region.stiffness) if clamped else region.energy if head else region.energy_free
    force_limit = region.force * (1.0 if clamped or head else region.transient)
    segment = SEGMENTS[int(touch[7]) % len(SEGMENTS)].name
    return Hit(float(fast.time[k]), segment, 0.5 * mass * closing**2, limit, bool(clamped), force, force_limit)
