"""A robot to test against: franka-sim's server of the FCI over MuJoCo, and a rod that pushes its arm.

Runs in an environment of its own, which has franka-sim but none of this project: ``python mujoco_arm.py JSON`` with the
fields of `Setting`. The rod's time and the log begin with SIGUSR1. It serves until SIGINT, SIGTERM or the end of who
started it, and then writes what was true to the log.
"""

import contextlib
import json
import logging
import os
import signal
import sys
import threading
from dataclasses import dataclass, field
from typing import Any

import mujoco
import numpy as np
from franka_sim import FrankaSimServer, mujoco_franka_sim
from franka_sim.mujoco_franka_sim import MujocoFrankaSim

from experiments.hardware.rod_law import RodParameters, rod_force

PREFIX, ROD = "fr3_", "rod"


@dataclass
class Setting:
    """The arm, what pushes it, and what the server insists on."""

    model: str  # URDF
    home: list[float]  # rad
    urdf: str = ""  # what the server tells its clients; empty: its own
    log: str = ""  # npz
    # Of each joint: Nms/rad, kg m², Nm.
    damping: float = 1.0
    armature: float = 0.1
    friction: float = 0.2
    # Where the rod waits (m, world) and the direction of its rail; none without them.
    origin: list[float] = field(default_factory=list)
    direction: list[float] = field(default_factory=list)
    rod: RodParameters = field(default_factory=RodParameters)
    # Whether the server ends a motion for what the FCI would end it for.
    comm_constraints: bool = False
    motion_limits: bool = False
    priority: int = 0


class Arm(MujocoFrankaSim):
    """The arm with the rod, and a log of every step since it was told to begin."""

    def __init__(self, setting: Setting) -> None:
        super().__init__()
        self._setting, self.begun = setting, False
        self._rows: list[np.ndarray] = []

    def initialize_simulation(self) -> None:
        """Build the model anew, with friction, reflected inertia and the rod."""
        s = self._setting
        spec = mujoco.MjSpec.from_file(s.model)
        for joint in spec.joints:
            joint.damping, joint.armature, joint.frictionloss = s.damping, s.armature, s.friction
        if s.direction:
            _add_rod(spec, s)
        spec.option.timestep = self.dt
        spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_ACTUATION
        for body in spec.bodies:
            body.gravcomp = 1.0
        for body in spec.bodies:  # the rod touches one link alone, and links do not touch one another
            touched = body.name == s.rod.link
            for geom in body.geoms:
                geom.contype, geom.conaffinity = (2, 1) if body.name == ROD else (int(touched), 2 * int(touched))
        self.model, self.prefix = spec.compile(), PREFIX
        self.data = mujoco.MjData(self.model)
        self._bind_model()
        self._rod = -1
        if s.direction:
            self._rod = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_JOINT, ROD)
        self.data.qpos[self.arm_qpos_adr] = s.home
        self.latest_joint_positions = np.array(s.home)
        mujoco.mj_forward(self.model, self.data)
        self._read_and_publish_state()

    def _apply_control(self) -> None:
        super()._apply_control()
        if not self.begun:
            return
        time, force = len(self._rows) * self.dt, 0.0
        if self._rod >= 0:
            at, dof = self.model.jnt_qposadr[self._rod], self.model.jnt_dofadr[self._rod]
            force = rod_force(self._setting.rod, time, self.data.qpos[at], self.data.qvel[dof])
            self.data.qfrc_applied[dof] = force
        q, v = self.data.qpos[self.arm_qpos_adr], self.data.qvel[self.arm_dofs_idx]
        touch = self.data.qfrc_constraint[self.model.jnt_dofadr[self._rod]] if self._rod >= 0 else 0.0
        torque = self.data.qfrc_applied[self.arm_dofs_idx]
        self._rows.append(np.concatenate([[time], q, v, torque, [force, touch]]))

    def save(self) -> None:
        """Write what was true: time, q, v, torque, force along the rod's rail on the robot."""
        if self._setting.log and self._rows:
            rows = np.array(self._rows)
            q, v, torque = rows[:, 1:8], rows[:, 8:15], rows[:, 15:22]
            with open(self._setting.log + ".part", "wb") as file:
                np.savez(file, time=rows[:, 0], q=q, v=v, torque=torque, force=-rows[:, 23])
            os.replace(self._setting.log + ".part", self._setting.log)


def _add_rod(spec: Any, s: Setting) -> None:
    body = spec.worldbody.add_body(name=ROD, pos=s.origin)
    axis = np.asarray(s.direction) / np.linalg.norm(s.direction)
    body.add_joint(name=ROD, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
    ball = body.add_geom(name=ROD, type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[s.rod.radius, 0.0, 0.0])
    ball.mass, ball.friction = s.rod.mass, [0.1, 0.0, 0.0]


def main() -> int:
    """Serve the arm of the setting in argv."""
    given = json.loads(sys.argv[1])
    setting = Setting(**{**given, "rod": RodParameters(**given.get("rod", {}))})
    logging.basicConfig(level=logging.WARNING, format="%(levelname)s %(message)s")
    logging.getLogger("franka_sim").setLevel(logging.WARNING)
    mujoco_franka_sim.SELF_COLLISION_LINKS = ()
    sys.setswitchinterval(5e-4)
    if setting.priority > 0:
        with contextlib.suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(setting.priority))
    arm = Arm(setting)
    server = FrankaSimServer(
        physics_sim=arm,
        enable_gripper=False,
        urdf_path=setting.urdf or None,
        enforce_comm_constraints=setting.comm_constraints,
        enforce_motion_limits=setting.motion_limits,
    )
    ended = threading.Event()
    signal.signal(signal.SIGUSR1, lambda *_: setattr(arm, "begun", True))
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ended.set())

    def serve() -> None:
        try:
            server.start()
        finally:
            ended.set()

    threading.Thread(target=serve, daemon=True).start()
    parent = os.getppid()
    while not ended.wait(0.2) and os.getppid() == parent:
        pass
    arm.save()
    server.stop()
    return 0


if __name__ == "__main__":
    code = main()
    sys.stdout.flush()
    os._exit(code)
