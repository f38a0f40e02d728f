"""A driver of an iiwa to test against, in a process of its own: Drake's, in its torque mode, over a simulated arm.

``python -m experiments.hardware.iiwa_driver URL ROBOT SECONDS``: a name of the catalog or a model file.
"""

import contextlib
import os
import sys
import time

from pydrake.lcm import DrakeLcm
from pydrake.manipulation import IiwaCommandReceiver, IiwaControlMode, IiwaDriver, IiwaStatusSender, SimIiwaDriver
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.lcm import LcmInterfaceSystem, LcmPublisherSystem, LcmSubscriberSystem

from saphari_drake.robots import catalog
from saphari_drake.stations.lcm import COMMAND, STATUS


def main(url: str, name: str, seconds: float) -> int:
    """Serve the robot in real time."""
    from drake import lcmt_iiwa_command, lcmt_iiwa_status

    robot, builder = catalog.load(name), DiagramBuilder()
    plant = builder.AddNamedSystem("plant", MultibodyPlant(0.001))
    instance = robot.add_to(plant)
    plant.Finalize()
    plant.SetDefaultPositions(instance, robot.home)
    inside = MultibodyPlant(0.0)
    robot.add_to(inside)
    inside.Finalize()
    n, lcm = robot.n, builder.AddSystem(LcmInterfaceSystem(DrakeLcm(url)))
    config = IiwaDriver(control_mode="torque_only")
    driver = builder.AddNamedSystem("driver", SimIiwaDriver(config, inside))
    received = builder.AddSystem(IiwaCommandReceiver(n, IiwaControlMode.kTorqueOnly))
    told = builder.AddSystem(LcmSubscriberSystem.Make(COMMAND, lcmt_iiwa_command, lcm, use_cpp_serializer=True))
    builder.Connect(told.get_output_port(), received.get_message_input_port())
    builder.Connect(plant.get_state_output_port(instance), driver.GetInputPort("state"))
    builder.Connect(received.get_commanded_torque_output_port(), driver.GetInputPort("torque"))
    builder.Connect(driver.GetOutputPort("actuation"), plant.get_actuation_input_port(instance))
    builder.Connect(
        plant.get_generalized_contact_forces_output_port(instance), driver.GetInputPort("generalized_contact_forces")
    )
    status = builder.AddSystem(IiwaStatusSender(n))
    for port in (
        "position_commanded",
        "position_measured",
        "velocity_estimated",
        "torque_commanded",
        "torque_measured",
        "torque_external",
    ):
        builder.Connect(driver.GetOutputPort(port), status.GetInputPort(port))
    publisher = builder.AddSystem(
        LcmPublisherSystem.Make(STATUS, lcmt_iiwa_status, lcm, publish_period=0.001, use_cpp_serializer=True)
    )
    builder.Connect(status.get_output_port(), publisher.get_input_port())
    simulator = Simulator(builder.Build())
    simulator.Initialize()
    with contextlib.suppress(OSError):  # as a robot's own computer does
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(40))
    print("ready", flush=True)
    serve(simulator, seconds)
    return 0


def serve(simulator: Simulator, seconds: float, period: float = 0.001) -> None:
    """Advance at the pace of the clock; time that was lost is not made up for, as it would not be by a robot."""
    due = time.perf_counter()
    parent = os.getppid()
    for k in range(round(seconds / period)):
        if os.getppid() != parent:  # nobody is left to end it
            return
        simulator.AdvanceTo((k + 1) * period)
        due = max(due + period, time.perf_counter() - period)
        time.sleep(max(due - time.perf_counter(), 0.0))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], sys.argv[2], float(sys.argv[3])))
