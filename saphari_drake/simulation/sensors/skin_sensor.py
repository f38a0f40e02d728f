"""SkinSensor: the voltages of a skin patch in a running plant."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue, Value
from pydrake.multibody.plant import ContactResults, ExternallyAppliedSpatialForce, MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import BasicVector, Context, EventStatus, LeafSystem, State

from saphari_drake.parameters import require_non_negative, require_positive
from saphari_drake.perception.skin.layout import CELLS, SkinLayout
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.sensors.skin_modules import SkinLoad, SkinModuleParameters, SkinModules
from saphari_drake.systems import cycle

Array = NDArray[np.float64]


@dataclass
class SkinSensorParameters:
    """The modules, and what disturbs them while they are read; all values assumed."""

    modules: SkinModuleParameters = field(default_factory=SkinModuleParameters)
    # s; sampling period.
    period: float = 0.002
    # Seed of noise and drift, ≥ 0.
    seed: int = 0
    # V; noise of a cell.
    noise: float = 0.001
    # V/√s; random walk of each cell's offset, and of all together (warming up).
    drift: float = 0.0002
    common_drift: float = 0.0002
    # s; from then on the dead modules are dead. 0: from the start.
    dead_time: float = 0.0
    # m; radius of the contact patch of a 10 N touch; it grows with the cube root of the force.
    contact_radius: float = 0.006
    # m; a contact farther than this from the patch's surface does not press on it.
    reach: float = 0.015

    def __post_init__(self) -> None:
        require_positive(self, "period", "contact_radius", "reach")
        require_non_negative(self, "seed", "noise", "drift", "common_drift", "dead_time")


class SkinSensor(LeafSystem):
    """Samples and holds the voltages of a skin patch.

    .. pydrake_system::

        name: SkinSensor
        input_ports:
        - state
        - contact_results
        - applied_forces
        output_ports:
        - voltages
        - sample_time

    Ports
    -----
    state : 2n (rad or m, then rad/s or m/s), from the plant.
    contact_results : abstract `ContactResults` of the plant, optional; all point contacts on the link that carries the
        skin.
    applied_forces : abstract list of `ExternallyAppliedSpatialForce`, optional, as the plant gets them; those on
        that link. Torques are left out.
    voltages : 4m (V), the cells of module 0, then of module 1, …
    sample_time : 1 (s), when they were read.

    State: the held sample, its time, the drift of each cell, and the number of samples, from which noise and drift
    follow with the seed: a clone of the Context reads the same.

    Parameters
    ----------
    layout : SkinLayout
    robot : RobotModel
    plant, instance : MultibodyPlant, ModelInstanceIndex
        Where the robot is simulated.
    params : SkinSensorParameters, optional
    """

    def __init__(
        self,
        layout: SkinLayout,
        robot: RobotModel,
        plant: MultibodyPlant,
        instance: ModelInstanceIndex,
        params: SkinSensorParameters | None = None,
    ) -> None:
        super().__init__()
        self._layout, self._robot = layout, robot
        self._params = params = params or SkinSensorParameters()
        self.modules = SkinModules(layout, params.modules)
        alive = SkinModuleParameters(**{**vars(params.modules), "dead": []})
        self._before = SkinModules(layout, alive) if params.dead_time > 0.0 else self.modules
        self._X_LB = {}
        link = plant.GetBodyByName(layout.link_name, instance)
        context = plant.CreateDefaultContext()
        for body in plant.GetBodiesWeldedTo(link):
            self._X_LB[int(body.index())] = body.body_frame().CalcPose(context, link.body_frame())
        robot.kinematics(robot.home)  # compiles
        self._state = self.DeclareVectorInputPort("state", BasicVector(2 * robot.n))
        self._contacts = self.DeclareAbstractInputPort("contact_results", AbstractValue.Make(ContactResults()))
        forces = Value[list[ExternallyAppliedSpatialForce]]()
        self._applied = self.DeclareAbstractInputPort("applied_forces", forces)
        self._voltages = self.DeclareDiscreteState(self.modules.offset.ravel())
        self._time = self.DeclareDiscreteState(np.array([0.0]))
        self._drift = self.DeclareDiscreteState(CELLS * layout.count)
        self._count = self.DeclareDiscreteState(1)
        self.DeclareInitializationUnrestrictedUpdateEvent(self._sample)
        self.DeclarePeriodicUnrestrictedUpdateEvent(**cycle(params.period), update=self._sample)
        self.DeclareStateOutputPort("voltages", self._voltages)
        self.DeclareStateOutputPort("sample_time", self._time)

    def touches(self, context: Context) -> list[SkinLoad]:
        """Return the contacts on the link at this moment, in the link frame."""
        q = self._state.Eval(context)[: self._robot.n]
        motion, link = self._robot.kinematics(q), self._layout.link
        R_WL, p_WL = motion.R_WL[link], motion.p_WL[link]
        touches = []
        if self._contacts.HasValue(context):
            results: ContactResults = self._contacts.Eval(context)
            for i in range(results.num_point_pair_contacts()):
                info = results.point_pair_contact_info(i)
                on_a, on_b = int(info.bodyA_index()) in self._X_LB, int(info.bodyB_index()) in self._X_LB
                if on_a != on_b:  # contact_force() acts on body B
                    f_W = info.contact_force() if on_b else -info.contact_force()
                    touches += self._touch(R_WL.T @ (info.contact_point() - p_WL), R_WL.T @ f_W)
        if self._applied.HasValue(context):
            applied: Sequence[ExternallyAppliedSpatialForce] = self._applied.Eval(context)
            for force in applied:
                X_LB = self._X_LB.get(int(force.body_index))
                if X_LB is not None:
                    touches += self._touch(X_LB @ force.p_BoBq_B, R_WL.T @ force.F_Bq_W.translational())
        return touches

    def _touch(self, p_LC: Array, f_L: Array) -> list[SkinLoad]:
        size = float(np.linalg.norm(f_L))
        _, height = self._layout.coordinates(p_LC)
        if size == 0.0 or abs(height) > self._params.reach:
            return []
        return [SkinLoad(p_LC, f_L, self._params.contact_radius * (size / 10.0) ** (1.0 / 3.0))]

    def _sample(self, context: Context, state: State) -> EventStatus:
        params, now = self._params, context.get_time()
        count = int(context.get_discrete_state(self._count).value()[0])
        rng = np.random.Generator(np.random.SFC64([params.seed, count]))
        cells = CELLS * self._layout.count
        drift = context.get_discrete_state(self._drift).value()
        walk = params.drift * rng.standard_normal(cells) + params.common_drift * rng.standard_normal()
        drift = drift + np.sqrt(params.period) * walk
        extra = drift + params.noise * rng.standard_normal(cells)
        modules = self.modules if now >= params.dead_time else self._before
        read = modules.voltages(*modules.forces(self.touches(context)), extra.reshape(-1, CELLS))
        state.get_mutable_discrete_state(self._voltages).SetFromVector(read.ravel())
        state.get_mutable_discrete_state(self._time).SetFromVector([now])
        state.get_mutable_discrete_state(self._drift).SetFromVector(drift)
        state.get_mutable_discrete_state(self._count).SetFromVector([count + 1.0])
        return EventStatus.Succeeded()
