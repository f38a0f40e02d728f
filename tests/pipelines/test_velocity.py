"""The pipeline behind a velocity command on a simulated arm, whatever the command is."""

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantValueSource

from saphari_drake.messages import ObstaclePoints
from saphari_drake.pipelines.envelope import JointState
from saphari_drake.pipelines.velocity import VelocityPipelineParameters, add_velocity_pipeline
from saphari_drake.robots import catalog
from saphari_drake.simulation.sensors.joint_sensor import JointSensor, JointSensorParameters
from saphari_drake.simulation.world.cell import add_cell
from saphari_drake.simulation.world.references import Reference


def run(command, duration, obstacle=None):
    """Return pipeline, times and states (k, 2n) every millisecond of an arm under ``command(t)``, (n,) in rad/s."""
    robot, builder = catalog.lwr4(), DiagramBuilder()
    cell = add_cell(builder, robot)
    sensor = builder.AddSystem(JointSensor(robot, JointSensorParameters(period=0.001, differentiate=False)))
    builder.Connect(cell.robot_state, sensor.GetInputPort("state"))
    ports = {}
    if obstacle is not None:
        source = builder.AddSystem(ConstantValueSource(AbstractValue.Make(obstacle)))
        ports["things"] = source.get_output_port()
    state = JointState(sensor.GetOutputPort("position_measured"), sensor.GetOutputPort("velocity_measured"))
    pipeline = add_velocity_pipeline(builder, robot, state, VelocityPipelineParameters(), **ports)
    commanded = builder.AddSystem(Reference({"value": command}, 0.001))
    builder.Connect(commanded.GetOutputPort("value"), pipeline.command_input)
    builder.Connect(pipeline.torque_output, cell.torque_input)
    simulator, states = Simulator(builder.Build()), []
    context = cell.plant.GetMyContextFromRoot(simulator.get_context())
    for time in np.arange(1, round(duration / 0.001)) * 0.001:
        simulator.AdvanceTo(time)
        states.append(np.array(cell.robot_state.Eval(context)))
    return robot, pipeline, np.array(states)


def noise(time):
    """Return a velocity far beyond all limits, another one each 20 ms."""
    return 20.0 * np.random.default_rng(int(time / 0.02)).uniform(-1.0, 1.0, 7)


def one_joint(time):
    """Return a velocity far beyond its limit for one joint, another one each 100 ms."""
    rng = np.random.default_rng(int(time / 0.1))
    return 20.0 * rng.choice([-1.0, 1.0]) * np.eye(7)[rng.integers(7)]


@pytest.mark.parametrize("command", [noise, one_joint, lambda time: np.full(7, 20.0)], ids=["noise", "one", "one way"])
def test_no_command_leaves_the_limits(command):
    robot, pipeline, states = run(command, 1.5)
    q, v = states[:, :7], states[:, 7:]
    assert pipeline.stop is None
    assert np.all(q >= robot.q_min) and np.all(q <= robot.q_max)
    assert 0.9 < np.max(np.abs(v) / robot.v_max) <= 1.0


def test_a_command_that_is_no_number_stops_the_arm():
    _, _, states = run(lambda time: np.full(7, 0.3 if time < 0.4 else np.nan), 1.0)
    assert np.abs(states[390, 7:]).max() > 0.25
    assert np.abs(states[-1, 7:]).max() < 1e-3


def test_the_arm_stops_before_an_obstacle_whoever_commands():
    """The first joint turns the arm into a thing that stands in its way; without it the arm passes there."""
    turn = np.array([0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    robot = catalog.lwr4()
    p = robot.kinematics(robot.home + 1.2 * np.eye(7)[0]).p_WL[-1]
    thing = ObstaclePoints(p[None], np.zeros((1, 3)), np.array([0.05]), 0.0)
    free = run(lambda time: turn, 3.5)[2]
    _, pipeline, states = run(lambda time: turn, 3.5, thing)
    assert free[-1, 0] > 1.5
    assert 0.2 < states[-1, 0] < 1.1 and abs(states[-1, 7]) < 1e-3
    assert pipeline.velocity_output is pipeline.stop.GetOutputPort("velocity_applied")
