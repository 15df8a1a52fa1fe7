"""Faults of the camera and of the network that looks through it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Protocol

import msgspec
import numpy as np

from agribot.core.messages import ByteArray, CameraFrame, Scene, SensorBatch
from agribot.sim.faults.schedule import Fault


class BadPicture:
    """Other pixels, or none: black, upside down, mirrored, frozen, off."""

    def __init__(self, fault: Fault) -> None:
        self._fault = fault
        self._last: ByteArray | None = None

    def alter(self, batch: SensorBatch) -> SensorBatch:
        if not batch.frames:
            return batch
        frames = tuple(self._spoil(frame) for frame in batch.frames)
        return msgspec.structs.replace(batch, frames=tuple(f for f in frames if f is not None))

    def _spoil(self, frame: CameraFrame) -> CameraFrame | None:
        image = frame.image_rgb
        if not self._fault.is_on(frame.t_s):
            self._last = image
            return frame
        match self._fault.name:
            case "camera.off":
                return None
            case "camera.black":
                image = np.zeros_like(image)
            case "camera.flipped":
                image = np.ascontiguousarray(image[::-1, ::-1])
            case "camera.mirrored":
                image = np.ascontiguousarray(image[:, ::-1])
            case _ if self._last is not None:
                image = self._last
        return msgspec.structs.replace(frame, image_rgb=image)


def find_mount_shift_m(faults: Sequence[Fault], t_s: float) -> float:
    """Find how far to the left of its place the camera's mount is at a time."""
    shift_m = 0.0
    for fault in faults:
        if fault.is_on(t_s) and fault.name == "camera.shifted":
            shift_m += fault.number
        elif fault.is_on(t_s) and fault.name == "camera.creeping":
            shift_m += fault.number * (t_s - fault.begin_s)
    return shift_m


class Looking(Protocol):
    """Viewer of the frames of a batch, off the control loop."""

    @property
    def meter(self) -> Any: ...
    def step(self, batch: SensorBatch) -> tuple[Scene, ...]: ...
    def settle(self) -> None: ...
    def close(self) -> None: ...


class HungNetwork:
    """Whatever looks, but frames of a time at which it hangs are never answered.

    The stack still gets every frame; `read_clock` gives the true time, s.
    """

    def __init__(
        self, looking: Looking, faults: Sequence[Fault], read_clock: Callable[[], float]
    ) -> None:
        self._looking, self._faults, self._read_clock = looking, tuple(faults), read_clock

    @property
    def meter(self) -> Any:
        return self._looking.meter

    def step(self, batch: SensorBatch) -> tuple[Scene, ...]:
        now_s = self._read_clock()
        if any(fault.is_on(now_s) for fault in self._faults):
            batch = msgspec.structs.replace(batch, frames=())
        return self._looking.step(batch)

    def settle(self) -> None:
        self._looking.settle()

    def close(self) -> None:
        self._looking.close()
