"""People as cameras and viewers see them."""

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.geometry import Capsule, FramePoseVector, SceneGraph, Sphere
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder, LeafSystem, State

from saphari_drake.simulation.people.compliant_people import COUNT, CompliantPeople
from saphari_drake.simulation.people.skeleton import SEGMENTS
from saphari_drake.simulation.world.person_body import SKIN, register_shown
from saphari_drake.systems import cycle

_CLOTH = np.array([0.35, 0.45, 0.62, 1.0])
SHOWN = 0.01  # s, how often cameras and viewers see people elsewhere


class ShownPeople(LeafSystem):
    """Poses of people's capsules, sampled: a plant asks for all poses at every step.

    .. pydrake_system::

        name: ShownPeople
        input_ports:
        - ends
        output_ports:
        - geometry_pose

    Ports
    -----
    ends : 6 a segment (m), from `CompliantPeople`.
    geometry_pose : abstract `FramePoseVector`, for a SceneGraph.

    Parameters
    ----------
    scene_graph : SceneGraph
        Gets the capsules, for perception and illustration; its cameras are not added yet.
    people : CompliantPeople
    """

    def __init__(self, scene_graph: SceneGraph, people: CompliantPeople) -> None:
        super().__init__()
        self.source_id = scene_graph.RegisterSource(people.get_name())
        self._frames = []
        for k, (length, radius) in enumerate(people.sizes()):
            segment, shape = SEGMENTS[k % COUNT], Capsule(radius, length) if length > 1e-3 else Sphere(radius)
            rgba = SKIN if segment.region in ("skull", "neck", "hand", "forearm") else _CLOTH
            name = f"{segment.name} {k // COUNT}"
            self._frames.append(register_shown(scene_graph, self.source_id, name, shape, rgba))
        self._ends = self.DeclareVectorInputPort("ends", BasicVector(6 * len(self._frames)))
        self._shown = self.DeclareDiscreteState(6 * len(self._frames))
        self.DeclareAbstractOutputPort(
            "geometry_pose",
            alloc=lambda: Value[FramePoseVector](),
            calc=self._calc,
            prerequisites_of_calc={self.discrete_state_ticket(self._shown)},
        )
        self.DeclareInitializationUnrestrictedUpdateEvent(self._show)
        self.DeclarePeriodicUnrestrictedUpdateEvent(**cycle(SHOWN), update=self._show)

    def _calc(self, context: Context, output: AbstractValue) -> None:
        poses = FramePoseVector()
        shown = context.get_discrete_state(self._shown).value().reshape(-1, 2, 3)
        for frame, (a, b) in zip(self._frames, shown):
            along = b - a
            straight = np.linalg.norm(along) > 1e-6
            R = RotationMatrix.MakeFromOneVector(along, 2) if straight else RotationMatrix()
            poses.set_value(frame, RigidTransform(R, 0.5 * (a + b)))
        output.set_value(poses)

    def _show(self, context: Context, state: State) -> None:
        state.get_mutable_discrete_state(self._shown).SetFromVector(self._ends.Eval(context))


def show_people(builder: DiagramBuilder, scene_graph: SceneGraph, people: CompliantPeople) -> None:
    """Show people of a diagram in its scene graph, whose cameras are not added yet."""
    shown = builder.AddNamedSystem("shown_people", ShownPeople(scene_graph, people))
    builder.Connect(people.GetOutputPort("ends"), shown.get_input_port())
    builder.Connect(shown.get_output_port(), scene_graph.get_source_pose_port(shown.source_id))
