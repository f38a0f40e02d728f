"""Wall time of the contact cycle over all links, rendering apart: each stage, one and two cameras, and the baseline.

Run as ``python tests/benchmarks/benchmark_localization.py [--json FILE]``; everything runs on one pinned thread.
Shares are those of the whole cycle.
"""

import os
import sys
import time
from collections import defaultdict
from pathlib import Path

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[name] = "1"
if hasattr(os, "sched_setaffinity"):
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
sys.path[:0] = [str(Path(__file__).parents[2] / "diagrams"), str(Path(__file__).parents[1])]

import numpy as np  # noqa: E402
from bench import Timings, benchmark_options  # noqa: E402
from experiments.localization.parameters import KINDS, SceneParameters  # noqa: E402
from experiments.localization.published import published_localization  # noqa: E402
from experiments.localization.pushes import torque_noise, wandering_forces  # noqa: E402
from experiments.localization.scenes import ContactScenes  # noqa: E402

from saphari_drake.perception.camera.frames import instant  # noqa: E402
from saphari_drake.perception.camera.model import CameraParameters  # noqa: E402
from saphari_drake.perception.contact import evidence as kernels  # noqa: E402
from saphari_drake.perception.contact.law import ContactFusionLaw  # noqa: E402
from saphari_drake.perception.contact.parameters import FusionParameters, LocalizerParameters  # noqa: E402
from saphari_drake.perception.contact.places import PlaceFinder  # noqa: E402
from saphari_drake.perception.segmentation.background import background_depth  # noqa: E402
from saphari_drake.perception.segmentation.robot_filter import RobotFilter  # noqa: E402
from saphari_drake.robots.catalog import lwr4  # noqa: E402

SCENES, FRAMES = 30, 8
CAMERAS = [CameraParameters(), CameraParameters(position=[1.2, 1.4, 1.2])]


class Clock:
    """Wall time and processor time (s) of this thread, by stage."""

    def __init__(self):
        self.wall, self.thread = defaultdict(list), defaultdict(list)

    def __call__(self, name, function, *arguments):
        """Call a function and note its times."""
        wall, thread = time.perf_counter(), time.thread_time()
        result = function(*arguments)
        self.wall[name].append(time.perf_counter() - wall)
        self.thread[name].append(time.thread_time() - thread)
        return result


def look(finders, images, at):
    """Return what the cameras show."""
    return [finder.look(image, at.R_WL, at.p_WL, 2) for finder, image in zip(finders, images)]


def cycle(law, finders, memory, q, r, images):
    """One whole contact cycle."""
    at = instant(law.robot, 0.0, q, r)
    memory = law.remember(memory, law.evidence(at, look(finders, images, at)))
    return memory, law.decide(memory)


def measure(law, finders, scenes):
    """Return the times of each stage over random scenes."""
    clock, t = Clock(), law.candidates
    for index in range(SCENES):
        rng = np.random.default_rng([7, index])
        touch = scenes.draw(rng, 1 + index % 6, KINDS[index % 3])
        images = [scenes.noisy(z, k, rng) for k, z in enumerate(scenes.images([touch], touch.q)[: len(finders)])]
        terms = scenes.poses(touch.q)
        forces = wandering_forces(rng, touch, FRAMES, scenes.params) @ terms.R_WL[touch.link].T
        noise = torque_noise(rng, scenes.robot.n, FRAMES, scenes.params)
        residuals = forces @ terms.point(touch.link, touch.p_L).Jv_WC + noise
        memory = law.empty()
        for r in residuals:
            memory, _ = clock("whole cycle", cycle, law, finders, memory, touch.q, r, images)
        x, a = kernels.pose_points(t.link, t.p_L, t.n_L, terms.R_WL, terms.p_WL)
        for r in residuals:
            at = instant(law.robot, 0.0, touch.q, r)
            for finder, image in zip(finders, images):
                clock("- vision, a camera", finder.look, image, at.R_WL, at.p_WL, 2)
            clock("- cameras, all candidates", law.vision_cost, x, a, look(finders, images, at))
            clock(
                "- residual, all candidates",
                kernels.residual_costs,
                terms.parent,
                at.motion.S,
                t.link,
                x,
                a,
                r,
                law._model,
            )
            clock("- modes, refinement and cone force", law.decide, memory)
            clock("published method", published_localization, finders[0].camera, images[0], terms, r, 0.6)
    return clock


def main():
    """Print the table."""
    options, timings = benchmark_options(__doc__), Timings()
    robot = lwr4()
    scenes = ContactScenes(robot, CAMERAS, SceneParameters())
    rng = np.random.default_rng(0)
    backgrounds = [background_depth(scenes.background(k, rng)) for k in range(2)]
    for count, bound in ((1, 3.0), (2, 5.0)):
        params = LocalizerParameters()
        finders = [
            PlaceFinder(RobotFilter(robot.shapes, camera, params, background), params)
            for camera, background in zip(CAMERAS[:count], backgrounds)
        ]
        law = ContactFusionLaw(robot, FusionParameters())
        measure(law, finders, scenes)  # warm
        print(f"\n{count} camera(s); bound of the whole cycle: p95 ≤ {bound} ms")
        clock = measure(law, finders, scenes)
        print(f"  {'stage':<36}{'wall: median':>14}{'p95':>8}{'thread: median':>17}{'p95':>8}  (ms){'share':>8}")
        for name in clock.wall:
            values = [1e3 * np.percentile(t[name], share) for t in (clock.wall, clock.thread) for share in (50, 95)]
            times = count if name.startswith("- vision") else 1
            share = times * np.median(clock.thread[name]) / np.median(clock.thread["whole cycle"])
            whole = name == "whole cycle"
            peer = f"published method, {count} camera(s)" if whole else None
            timings.add(f"{name}, {count} camera(s)", clock.wall[name], None, bound if whole else None, peer)
            print(f"  {name:<36}{values[0]:14.2f}{values[1]:8.2f}{values[2]:17.2f}{values[3]:8.2f}{share:13.0%}")
    timings.write(options.json)


if __name__ == "__main__":
    main()
