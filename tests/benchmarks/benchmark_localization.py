"""Wall time of the contact cycle over all links, rendering apart: each stage, one and two cameras, and the baseline.

Run as ``python tests/benchmarks/benchmark_localization.py``; everything runs on one thread.
"""

import time
from collections import defaultdict

import numpy as np

from saphari_drake.perception.fusion import ContactFusionLaw, FusionParameters
from saphari_drake.perception.localization import ContactVision, LocalizerParameters, background_depth
from saphari_drake.perception.rgbd_camera import CameraParameters
from saphari_drake.robots.catalog import lwr4
from saphari_drake.simulation.contact_scenes import KINDS, ContactScenes, SceneParameters
from saphari_drake.simulation.published_localization import published_localization

SCENES, FRAMES = 60, 8
CAMERAS = [CameraParameters(), CameraParameters(position=[1.2, 1.4, 1.2])]


def timed(times, name, call):
    """Call and note the wall time."""
    start = time.perf_counter()
    result = call()
    times[name].append(time.perf_counter() - start)
    return result


def measure(law, scenes, count):
    """Return the times (s) of each stage over random scenes."""
    times = defaultdict(list)
    for index in range(SCENES):
        rng = np.random.default_rng([7, index])
        touch = scenes.draw(rng, 1 + index % 6, KINDS[index % 3])
        images = [scenes.noisy(z, k, rng) for k, z in enumerate(scenes.images([touch], touch.q)[:count])]
        terms = scenes.poses(touch.q)
        forces = scenes.forces(rng, touch, FRAMES) @ terms.R_WL[touch.link].T
        residuals = forces @ terms.point(touch.link, touch.p_L).Jv_WC + scenes.torque_noise(rng, FRAMES)
        memory = law.empty()
        for r in residuals:
            start = time.perf_counter()
            evidence = law.evidence(touch.q, r, images)
            memory = timed(times, "memory", lambda m=memory, e=evidence: law.remember(m, e))
            timed(times, "modes, refinement and cone force", lambda m=memory: law.decide(m))
            times["whole cycle"].append(time.perf_counter() - start)
        for vision, image in zip(law.visions, images):
            timed(times, "vision, a camera (part of evidence)",
                  lambda v=vision, z=image: v.localize_several(z, terms.R_WL, terms.p_WL, 2))  # fmt: skip
        timed(times, "evidence (vision, residual, visibility)", lambda: law.evidence(touch.q, residuals[-1], images))
        timed(times, "published method", lambda: published_localization(law.visions[0], images[0], terms, r, 0.6))
    return times


def main():
    """Print the table."""
    robot = lwr4()
    scenes = ContactScenes(robot, CAMERAS, SceneParameters())
    rng = np.random.default_rng(0)
    backgrounds = [background_depth(scenes.background(k, rng)) for k in range(2)]
    for count, bound in ((1, 3.0), (2, 5.0)):
        visions = [
            ContactVision(robot.shapes, camera, LocalizerParameters(), background)
            for camera, background in zip(CAMERAS[:count], backgrounds)
        ]
        law = ContactFusionLaw(robot, visions, FusionParameters())
        law.compile()
        measure(law, scenes, count)  # warm
        print(f"\n{count} camera(s); bound of the whole cycle: p95 ≤ {bound} ms")
        for name, values in sorted(measure(law, scenes, count).items(), key=lambda item: -np.median(item[1])):
            print(f"  {name:<42} median {1e3 * np.median(values):6.2f} ms  p95 {1e3 * np.percentile(values, 95):6.2f} ms")


if __name__ == "__main__":
    main()
