"""A controller with the switch and the torque limit behind it, wired as in every torque pipeline."""

from pydrake.systems.framework import DiagramBuilder

from saphari_drake.safety.command_switch import CommandSwitch, CommandSwitchParameters
from saphari_drake.safety.torque_limit import TorqueLimit
from saphari_drake.systems import connect


def chained(controller, robot, **switch):
    """Return the chain as one system with the ports of its parts; `switch_status` is the switch's."""
    builder = DiagramBuilder()
    params = CommandSwitchParameters(**switch)
    parts = controller, CommandSwitch(robot, params), TorqueLimit(robot, params.period)
    controller, switch, limit = (builder.AddSystem(part) for part in parts)
    connect(
        builder,
        (controller, "torque_commanded", switch),
        (switch, "torque_commanded", limit),
        (limit, "torque_applied", switch),
    )
    if controller.HasOutputPort("selection"):
        connect(builder, (controller, "selection", switch))
    names = [controller.get_input_port(k).get_name() for k in range(controller.num_input_ports())]
    for name in names:
        if name == "transition_left":
            connect(builder, (switch, name, controller))
        else:
            builder.ExportInput(controller.GetInputPort(name), name)
    builder.ConnectInput("dynamics", switch.GetInputPort("dynamics"))
    for k in range(controller.num_output_ports()):
        port = controller.get_output_port(k)
        builder.ExportOutput(port, port.get_name())
    for system, name in ((switch, "transition"), (limit, "torque_applied"), (limit, "torque_excess")):
        builder.ExportOutput(system.GetOutputPort(name), name)
    builder.ExportOutput(switch.GetOutputPort("system_status"), "switch_status")
    return builder.Build()
