"""A contact whose place is told beforehand, where no camera looks."""

from typing import NamedTuple

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder, LeafSystem, OutputPort
from pydrake.systems.primitives import ConstantValueSource, ConstantVectorSource, Multiplexer

from saphari_drake.estimation.contact_force import ContactForceEstimator, ContactForceParameters
from saphari_drake.messages import CameraStatus, ContactPoint
from saphari_drake.robots.model import RobotModel


class TipForce(NamedTuple):
    """The force of a hand at the tip, out of the residual."""

    estimator: ContactForceEstimator
    wrench: OutputPort  # 6 (Nm, N, world): no moment, and the force


class DeclaredContact(LeafSystem):
    """Says that whoever touches the robot does so at one point: a mark on its cover.

    .. pydrake_system::

        name: DeclaredContact
        output_ports:
        - contact_point
        - camera_status

    Ports
    -----
    contact_point : abstract `ContactPoint`, always found, seen now.
    camera_status : 1, `CameraStatus.OK`.
    """

    def __init__(self, robot: RobotModel, link: str, p_L: list[float]) -> None:
        super().__init__()
        index = robot.link_index(link)
        p_LC, n_L = robot.shapes.nearest_on(index, np.asarray(p_L, dtype=float))
        self._point = ContactPoint(True, index, p_LC, n_L, 0.0)

        def point(context: Context, output: AbstractValue) -> None:
            p = self._point
            output.set_value(ContactPoint(True, p.link, p.p_LC, p.n_L, 0.0, context.get_time()))

        self.DeclareAbstractOutputPort("contact_point", lambda: AbstractValue.Make(self._point), point)
        status = [float(CameraStatus.OK)]
        self.DeclareVectorOutputPort("camera_status", BasicVector(1), lambda context, out: out.SetFromVector(status))


def add_tip_force(builder: DiagramBuilder, robot: RobotModel, link: str, p_L: list[float]) -> TipForce:
    """Add an estimator of the force at a point of a link, whose torque and dynamics are left to connect."""
    point = ContactPoint(True, robot.link_index(link), np.asarray(p_L, dtype=float), np.array([0.0, 0.0, 1.0]), 0.0)
    tip = builder.AddNamedSystem("tip", ConstantValueSource(AbstractValue.Make(point)))
    estimator = builder.AddNamedSystem("tip_force", ContactForceEstimator(robot, ContactForceParameters()))
    none = builder.AddNamedSystem("no_moment", ConstantVectorSource(np.zeros(3)))
    wrench = builder.AddNamedSystem("tip_wrench", Multiplexer([3, 3]))
    builder.Connect(tip.get_output_port(), estimator.GetInputPort("contact_point"))
    builder.Connect(none.get_output_port(), wrench.get_input_port(0))
    builder.Connect(estimator.GetOutputPort("contact_force"), wrench.get_input_port(1))
    return TipForce(estimator, wrench.get_output_port())
