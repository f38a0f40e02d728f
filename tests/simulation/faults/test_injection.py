"""Faults in a wired diagram: what the sensors, the plant and the taker of the command get, and when it is answered."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from saphari_drake.control.joint_servo import JointVelocityServo
from saphari_drake.robots.dynamics import RobotDynamics
from saphari_drake.simulation.faults.injection import inject_into
from saphari_drake.simulation.faults.registry import ARM, possible
from saphari_drake.simulation.faults.watch import answer
from saphari_drake.simulation.sensors.joint_sensor import JointSensor, JointSensorParameters
from saphari_drake.simulation.world.cell import add_cell
from saphari_drake.simulation.world.profile import Truth
from saphari_drake.simulation.world.references import Reference
from saphari_drake.systems import connect

START = 0.05


class Loop:
    """An arm whose joints follow a velocity."""

    def __init__(self, robot, *names, period=0.001):
        builder = DiagramBuilder()
        self.robot, truth = robot, Truth(period=period, faults=dict.fromkeys(names, START))
        self.joint = truth.joint(robot)
        self.cell = add_cell(builder, robot, truth=truth)
        self.sensor = builder.AddNamedSystem("joint_sensor", JointSensor(robot, JointSensorParameters(0.001, 0.0)))
        dynamics = builder.AddNamedSystem("dynamics", RobotDynamics(robot))
        self.servo = builder.AddNamedSystem("joint_servo", JointVelocityServo(robot))
        wanted = builder.AddNamedSystem("wanted", Reference({"value": lambda t: 0.2 * np.sin(8.0 * t) * np.ones(7)}))
        builder.Connect(self.cell.robot_state, self.sensor.GetInputPort("state"))
        connect(
            builder,
            (self.sensor, "position_measured", dynamics),
            (self.sensor, "velocity_measured", dynamics),
            (dynamics, "dynamics", self.servo),
        )
        builder.Connect(wanted.get_output_port(), self.servo.GetInputPort("velocity_commanded"))
        builder.Connect(self.servo.GetOutputPort("torque_commanded"), self.cell.torque_input)
        inject_into(builder, self.cell, truth)
        self.diagram = builder.Build()
        self.simulator = Simulator(self.diagram)

    def run(self, end):
        self.simulator.AdvanceTo(end)
        return self

    def read(self, system, port, kind="Output"):
        context = system.GetMyContextFromRoot(self.simulator.get_context())
        return np.array(getattr(system, f"Get{kind}Port")(port).Eval(context))

    @property
    def answer(self):
        return answer(self.diagram, self.simulator.get_context())


@pytest.mark.parametrize("name", [name for name in possible(ARM) if possible(ARM)[name].part != "plant"])
def test_each_fault_of_an_arm_acts_after_its_start_alone(lwr4, name):
    """Until it begins the motion is that without it; afterwards it is another one."""
    good, bad = Loop(lwr4), Loop(lwr4, name, period=0.02)
    states = [loop.run(START - 0.002).read(loop.cell.plant, "lwr4_state") for loop in (good, bad)]
    assert np.array_equal(*states)
    states = [loop.run(START + 0.05).read(loop.cell.plant, "lwr4_state") for loop in (good, bad)]
    assert np.abs(states[0] - states[1]).max() > 1e-7 or name == "encoder_nan"


def test_an_encoder_that_is_dead_is_answered_at_once(lwr4):
    loop = Loop(lwr4, "encoder_nan").run(START + 0.02)
    assert np.isnan(loop.read(loop.sensor, "position_measured")[loop.joint])
    assert loop.answer.time == loop.answer.observable == pytest.approx(START, abs=0.003)
    assert 0.0 < loop.answer.speed_share < 1.0


def test_a_fault_that_nobody_sees_is_silent(lwr4):
    answer = Loop(lwr4, "torque_bias").run(START + 0.1).answer
    assert answer.time == answer.reaction == np.inf and answer.observable == pytest.approx(START, abs=0.003)


def test_a_fault_counts_from_its_first_effect(lwr4):
    """A frozen encoder has none until its joint has moved by the floor."""
    loop = Loop(lwr4, "encoder_freeze").run(START + 0.2)
    assert START + 0.02 < loop.answer.observable < START + 0.2


def test_without_faults_nothing_is_added(lwr4):
    loop = Loop(lwr4)
    assert loop.answer is None
    assert not [system for system in loop.diagram.GetSystems() if "Fault" in type(system).__name__]
