"""How much of its speed an arm keeps while a person comes nearer: speed and separation monitoring by itself."""

import numpy as np
from pydrake.common.value import AbstractValue

from saphari_drake import lwr4
from saphari_drake.messages import ObstaclePoints
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.safety import SpeedSeparation

robot = lwr4()
monitor = SpeedSeparation(robot)
context = monitor.CreateDefaultContext()
terms = evaluate_dynamics(robot, robot.home, np.zeros(robot.n))
monitor.GetInputPort("dynamics").FixValue(context, AbstractValue.Make(terms))
monitor.GetInputPort("velocity_commanded").FixValue(context, 0.5 * robot.v_max)
for away in (1.00, 0.40, 0.35, 0.30, 0.25):
    beside = terms.p_WL[-1:] + np.array([0.0, away, 0.0])
    person = ObstaclePoints(beside, np.zeros((1, 3)), np.array([0.1]), stamp=0.0)
    monitor.GetInputPort("people").FixValue(context, AbstractValue.Make(person))
    print(f"{away:.2f} m away: {monitor.GetOutputPort('speed_scale').Eval(context)[0]:.2f} of the speed")
