"""A person comes near, touches the robot and goes: the supervisor by itself."""

from pydrake.systems.analysis import Simulator

from saphari_drake.safety import CellState, Supervisor
from saphari_drake.safety.supervisor.law import Event

supervisor = Supervisor()
simulator = Simulator(supervisor)
context = simulator.get_mutable_context()
simulator.Initialize()
story = [(1.0, 1.0, 0), (1.5, 0.4, 0), (2.0, 0.0, 0), (3.0, 0.0, 1), (5.0, 1.0, 0)]
for until, scale, touched in story:
    supervisor.GetInputPort("speed_scale").FixValue(context, [scale])
    supervisor.GetInputPort("touched").FixValue(context, [touched])
    simulator.AdvanceTo(until)
    state, reason = (supervisor.GetOutputPort(name).Eval(context)[0] for name in ("state", "reason"))
    print(f"{until:.1f} s: {CellState(int(state)).name} because of {Event(int(reason)).name}")
