"""Starts and ends franka-sim's server, in the environment that has it."""

import json
import os
import signal
import subprocess
import tempfile
import time
from dataclasses import asdict
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from experiments.hardware.rod import rail
from experiments.hardware.rod_law import RodParameters
from saphari_drake.errors import SensorError
from saphari_drake.robots.model import RobotModel

ROOT = Path(__file__).parents[3]
ENVIRONMENT = "FRANKA_SIM_ENVIRONMENT"  # variable that names another folder than .franka-sim


def environment() -> Path:
    """Return the folder of the environment with franka-sim; `SensorError` if there is none."""
    folder = Path(os.environ.get(ENVIRONMENT, ROOT / ".franka-sim"))
    if not (folder / "bin" / "franka-sim-check").is_file():
        raise SensorError(
            f"no franka-sim in '{folder}': python3 -m venv .franka-sim && .franka-sim/bin/pip install franka-sim"
        )
    return folder


class FrankaSim:
    """An FR3 over the FCI at 127.0.0.1, simulated by MuJoCo in a process of its own. Use it with ``with``.

    Parameters
    ----------
    robot : RobotModel
        Its home is where the arm starts.
    rod : RodParameters, optional
        What pushes it, from `begin` on.
    enforce : bool
        Whether limits of motion and lost packets end a motion.
    """

    HOST = "127.0.0.1"

    def __init__(
        self, robot: RobotModel, rod: RodParameters | None = None, enforce: bool = True, priority: int = 40
    ) -> None:
        folder = environment()
        self._log = Path(tempfile.mkdtemp(prefix="franka-sim-"))
        setting: dict[str, Any] = {"model": str(robot.path), "home": robot.home.tolist(), "log": str(self.truth)}
        setting |= {"comm_constraints": enforce, "motion_limits": enforce, "priority": priority}
        if rod is not None:
            origin, direction = rail(robot, rod)
            setting |= {"origin": origin.tolist(), "direction": direction.tolist(), "rod": asdict(rod)}
        self._said = (self._log / "server.log").open("wb")
        self._process = subprocess.Popen(
            [folder / "bin" / "python", Path(__file__).with_name("mujoco_arm.py"), json.dumps(setting)],
            env={**os.environ, "PYTHONPATH": str(ROOT / "diagrams"), "OMP_NUM_THREADS": "1"},
            stdout=self._said,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        self.check(60.0)
        time.sleep(0.2)
        self.check()  # that was no other server at this address

    @property
    def truth(self) -> Path:
        """The log that the server writes at its end: time, q, v, torque and the rod's force."""
        return self._log / "truth.npz"

    def check(self, timeout: float = 10.0) -> None:
        """Wait until the server takes a client; the last one may still be torn down."""
        if self._process.poll() is not None:
            raise SensorError(f"franka-sim ended: {self.said()}")
        command = [str(environment() / "bin" / "franka-sim-check"), "--timeout", str(timeout)]
        if subprocess.run(command, capture_output=True).returncode != 0:
            self.close()
            raise SensorError(f"franka-sim does not answer: {self.said()}")

    def begin(self) -> None:
        """Let the rod's time and the log of the truth begin now."""
        self._process.send_signal(signal.SIGUSR1)

    def said(self) -> str:
        """Return the last line that the server said."""
        lines = (self._log / "server.log").read_text(errors="replace").strip().splitlines()
        return lines[-1] if lines else ""

    def warnings(self) -> list[str]:
        """Return what the server found wrong with the motion so far."""
        lines = (self._log / "server.log").read_text(errors="replace").splitlines()
        return [line for line in lines if line.startswith(("WARNING ", "ERROR ")) and "self-collision" not in line]

    def close(self) -> dict[str, np.ndarray]:
        """End the server and return what was true; empty if nobody took control."""
        if self._process.poll() is None:
            self._process.send_signal(signal.SIGTERM)
            try:
                self._process.wait(20.0)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
            time.sleep(0.1)
        self._said.close()
        if not self.truth.is_file():
            return {}
        with np.load(self.truth) as archive:
            return {name: archive[name] for name in archive.files}

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
