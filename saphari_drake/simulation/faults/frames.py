"""Faults of a camera's frames: frozen, late, blind in a patch, noisy, or from a camera that was moved."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import BasicVector, Context, EventStatus, LeafSystem, State
from pydrake.systems.sensors import ImageDepth32F

from saphari_drake.messages import Immutable

Depth = NDArray[np.float32]
STEP, OFFSET = 0.001, 5.0e-7  # s; between the delivery of a frame and the cycles that read it


@dataclass(frozen=True)
class _Frame(Immutable):
    depth: Depth
    stamp: float
    came: float  # s, when it was delivered


@dataclass(frozen=True)
class _Frames(Immutable):
    shown: _Frame
    pending: tuple[_Frame, ...] = ()


class FrameFault(LeafSystem):
    """Stands behind a camera's sampler: passes frames on until a fault begins, and then what it makes of them.

    .. pydrake_system::

        name: FrameFault
        input_ports:
        - depth_image
        - image_time
        output_ports:
        - depth_image
        - image_time

    Ports
    -----
    depth_image (input) : abstract `ImageDepth32F` (m), of the sampler.
    image_time (input) : 1 (s), when it was taken; −1: no frame yet.
    depth_image (output) : abstract `ImageDepth32F` (m).
    image_time (output) : 1 (s).

    State: the frame that is shown, and those that are late.

    Parameters
    ----------
    width, height : int
    start : float
        When the fault begins (s).
    spoil : callable
        ``spoil(image, shown, number) -> image`` of a frame's image, the one shown before, and its stamp in ms.
    delay : float
        How much later frames are shown (s).
    """

    def __init__(
        self,
        width: int,
        height: int,
        start: float,
        spoil: Callable[[Depth, Depth, int], Depth] = lambda image, shown, number: image,
        delay: float = 0.0,
    ) -> None:
        super().__init__()
        self._start, self._spoil, self._delay = start, spoil, delay
        image = ImageDepth32F(width, height)
        self._image = self.DeclareAbstractInputPort("depth_image", Value[ImageDepth32F](image))
        self._time = self.DeclareVectorInputPort("image_time", BasicVector(1))
        nothing = _Frames(_Frame(np.zeros((height, width), dtype=np.float32), -1.0, -1.0))
        self._state = self.DeclareAbstractState(AbstractValue.Make(nothing))
        self.DeclarePeriodicUnrestrictedUpdateEvent(STEP, OFFSET, self._look)
        ticket = {self.abstract_state_ticket(self._state)}
        self.DeclareAbstractOutputPort(
            "depth_image", alloc=lambda: AbstractValue.Make(image), calc=self._calc_image, prerequisites_of_calc=ticket
        )
        self.DeclareVectorOutputPort("image_time", BasicVector(1), self._calc_time, prerequisites_of_calc=ticket)

    def _look(self, context: Context, state: State) -> EventStatus:
        frames: _Frames = context.get_abstract_state(int(self._state)).get_value()
        now, stamp = context.get_time(), float(self._time.Eval(context)[0])
        newest = frames.pending[-1] if frames.pending else frames.shown
        pending = frames.pending
        if stamp > newest.stamp:
            image = np.array(self._image.Eval(context).data[..., 0])
            if now >= self._start:
                image = self._spoil(image, newest.depth, round(1e3 * stamp))
            pending = (*pending, _Frame(image, stamp, now))
        delay = self._delay if now >= self._start else 0.0
        due = [frame for frame in pending if now >= frame.came + delay - 1e-9]
        if not due and pending == frames.pending:
            return EventStatus.DidNothing()
        shown = due[-1] if due else frames.shown
        state.get_mutable_abstract_state(int(self._state)).set_value(_Frames(shown, pending[len(due) :]))
        return EventStatus.Succeeded()

    def _shown(self, context: Context) -> _Frame:
        frames: _Frames = context.get_abstract_state(int(self._state)).get_value()
        return frames.shown

    def _calc_image(self, context: Context, output: AbstractValue) -> None:
        output.get_mutable_value().mutable_data[..., 0] = self._shown(context).depth

    def _calc_time(self, context: Context, output: BasicVector) -> None:
        output.SetAtIndex(0, self._shown(context).stamp)


class CameraMoves(LeafSystem):
    """Shows what one camera sees, and from some time on what another one does.

    .. pydrake_system::

        name: CameraMoves
        input_ports:
        - before
        - after
        output_ports:
        - depth_image

    Ports
    -----
    before, after : abstract `ImageDepth32F` (m); only the one that is shown is rendered.
    depth_image : abstract `ImageDepth32F` (m).
    """

    def __init__(self, width: int, height: int, start: float) -> None:
        super().__init__()
        self._start = start
        image = ImageDepth32F(width, height)
        value = Value[ImageDepth32F](image)
        self._inputs = [self.DeclareAbstractInputPort(name, value) for name in ("before", "after")]
        tickets = {self.time_ticket(), self.all_input_ports_ticket()}
        self.DeclareAbstractOutputPort(
            "depth_image", alloc=lambda: AbstractValue.Make(image), calc=self._calc, prerequisites_of_calc=tickets
        )

    def _calc(self, context: Context, output: AbstractValue) -> None:
        shown = self._inputs[int(context.get_time() >= self._start)].Eval(context)
        output.get_mutable_value().mutable_data[:] = shown.data


def blind(share: float) -> Callable[[Depth, Depth, int], Depth]:
    """Return a fault without readings in a patch in the middle, of that share of height and width."""

    def spoil(image: Depth, shown: Depth, number: int) -> Depth:
        (top, left), (height, width) = (np.array(image.shape) * (1.0 - share) / 2).astype(int), image.shape
        image[top : height - top, left : width - left] = 0.0
        return image

    return spoil


def noisier(sigma: float, depth: float, seed: int) -> Callable[[Depth, Depth, int], Depth]:
    """Return a fault that makes noise thrice as large; the camera's own is `sigma` (m) at `depth` (m)."""

    def spoil(image: Depth, shown: Depth, number: int) -> Depth:
        seen = np.isfinite(image) & (image > 0.0)
        rng = np.random.Generator(np.random.SFC64([seed, number]))
        more = np.sqrt(8.0) * sigma / depth**2 * rng.standard_normal(image.shape, dtype=np.float32)
        image[seen] += more[seen] * image[seen] ** 2
        return image

    return spoil
