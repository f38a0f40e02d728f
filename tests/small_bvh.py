"""A small BVH file of a person, written by hand: twelve joints, y up, z ahead, x to the right, in mm."""

import numpy as np

_CHAIN = [
    ("hip", -1, (0, 0, 0)), ("torso", 0, (0, 0, 0)), ("neck", 1, (0, 320, 0)), ("head", 2, (0, 380, 100)),
    ("left_upper_arm", 1, (-150, 310, 0)), ("left_forearm", 4, (-270, 0, 0)), ("left_hand", 5, (-250, 0, 0)),
    ("right_upper_arm", 1, (150, 310, 0)), ("right_forearm", 7, (270, 0, 0)), ("right_hand", 8, (250, 0, 0)),
]  # fmt: skip


def hierarchy():
    def block(j, depth):
        name, _, offset = _CHAIN[j]
        channels = "6 Xposition Yposition Zposition Zrotation Yrotation Xrotation" if j == 0 else (
            "3 Zrotation Xrotation Yrotation"
        )  # fmt: skip
        lines = [f"{'ROOT' if j == 0 else 'JOINT'} {name}", "{", f"OFFSET {offset[0]} {offset[1]} {offset[2]}"]
        lines.append(f"CHANNELS {channels}")
        children = [k for k, (_, parent, _) in enumerate(_CHAIN) if parent == j]
        for k in children:
            lines += block(k, depth + 1)
        if not children:
            lines += ["End Site", "{", "OFFSET 0 0 0", "}"]
        return [*lines, "}"]

    return ["HIERARCHY", *block(0, 0)]


ORDER = [name for name, _, _ in _CHAIN]  # its depth-first order is that of the list


def write_bvh(path, frames, rate=100.0):
    """Write frames (T, 33): position of the root (mm), then three angles (deg) a joint."""
    rows = [" ".join(f"{value:g}" for value in frame) for frame in np.asarray(frames)]
    motion = ["MOTION", f"Frames: {len(rows)}", f"Frame Time: {1.0 / rate:g}", *rows]
    path.write_text("\n".join(hierarchy() + motion) + "\n")
    return path


def swinging(count=200):
    """Frames of a person who walks ahead and swings the right arm."""
    frames = np.zeros((count, 33))
    frames[:, 2] = np.linspace(0.0, 500.0, count)
    column = 3 + 3 * ORDER.index("right_upper_arm")
    frames[:, column + 2] = 40.0 * np.sin(np.linspace(0.0, 6.0, count))  # about y
    return frames
