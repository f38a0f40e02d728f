"""How fast an arm may touch a hand, free and before a wall: power and force limiting by itself."""

import numpy as np
from pydrake.common.value import AbstractValue

from saphari_drake import lwr4
from saphari_drake.messages import ObstaclePoints
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.safety import PowerForceLimit, PowerForceParameters
from saphari_drake.safety.power_force.parameters import Structure

robot = lwr4()
terms = evaluate_dynamics(robot, robot.home, np.zeros(robot.n))
hand = terms.p_WL[-1:] + np.array([0.0, 0.07, 0.0])
for name, walls in (
    ("free", []),
    ("clamped", [Structure([*hand[0, :1], hand[0, 1] + 0.14, hand[0, 2]], [1.0, 0.2, 1.0])]),
):
    limit = PowerForceLimit(robot, PowerForceParameters(head_height=0.0, structures=walls))
    context = limit.CreateDefaultContext()
    person = ObstaclePoints(hand, np.zeros((1, 3)), np.array([0.03]), stamp=0.0)
    for port, value in (("dynamics", terms), ("people", person)):
        limit.GetInputPort(port).FixValue(context, AbstractValue.Make(value))
    limit.GetInputPort("velocity_commanded").FixValue(context, 3.0 * np.eye(robot.n)[0])
    energy, most, scale = (limit.GetOutputPort(x).Eval(context)[0] for x in ("energy", "energy_limit", "speed_scale"))
    print(f"{name}: {energy:.2f} J of {most:.2f} J, {scale:.2f} of the speed is allowed")
