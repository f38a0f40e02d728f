"""A diagram that swings a robot through its station, in a process of its own: to be killed.

``python station_swing.py ADDRESS ROBOT SECONDS``: ROBOT is a model file or a name of the catalog.
"""

import sys

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import BasicVector, DiagramBuilder, LeafSystem

from saphari_drake.robots import catalog
from saphari_drake.robots.dynamics import RobotDynamics, evaluate_dynamics
from saphari_drake.safety.posture_laws import posture_torque
from saphari_drake.stations import RobotStation, StationParameters, StationProcess, follow

REACH, RATE = 0.3, 4.0  # rad and rad/s of each joint's swing


class Swing(LeafSystem):
    """Torque (n) that swings all joints about a posture."""

    def __init__(self, robot, q):
        super().__init__()
        terms, n = evaluate_dynamics(robot, q, np.zeros(robot.n)), robot.n
        self._port = self.DeclareAbstractInputPort("dynamics", AbstractValue.Make(terms))
        signs = np.where(np.arange(n) % 2 == 0, 1.0, -1.0)

        def calc(context, output):
            wanted = q + signs * REACH * np.sin(RATE * context.get_time()) * min(context.get_time(), 1.0)
            now = self._port.Eval(context)
            known = now.finite
            gains = np.full(n, 225.0), np.full(n, 10.0)
            output.SetFromVector(posture_torque(now, wanted, *gains) if known else np.full(n, np.nan))

        self.DeclareVectorOutputPort("torque", BasicVector(n), calc)


def swing(process, robot, params, seconds):
    """Swing the robot of a started station."""
    q = process.link.reading.read()["position"]
    builder = DiagramBuilder()
    station = builder.AddSystem(RobotStation(robot, process.link, params))
    dynamics, law = builder.AddSystem(RobotDynamics(robot)), builder.AddSystem(Swing(robot, q))
    ports = station.ports
    builder.Connect(ports.position_measured, dynamics.GetInputPort("position_measured"))
    builder.Connect(ports.velocity_measured, dynamics.GetInputPort("velocity_measured"))
    builder.Connect(dynamics.get_output_port(), law.get_input_port())
    builder.Connect(law.get_output_port(), ports.torque_applied)
    simulator = Simulator(builder.Build())
    print(f"begins {process.pid}", flush=True)
    return follow(simulator, process, params, seconds)


if __name__ == "__main__":
    robot, params = catalog.load(sys.argv[2]), StationParameters()
    with StationProcess(sys.argv[1], robot, params) as process:
        print(swing(process, robot, params, float(sys.argv[3])), process.said(), flush=True)
