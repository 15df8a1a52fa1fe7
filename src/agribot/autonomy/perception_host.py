"""Where frames meet the network: off the control loop, in the order they were captured.

A host takes the frames of a batch and hands back the scenes that are usable by now. The scene
of a frame becomes usable a fixed `latency_s` after its capture: the loop never sees a result
earlier or later because of a busy core, so a simulated run repeats bit by bit.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from typing import Protocol

from agribot.core.messages import CameraFrame, Scene, SensorBatch

Observer = Callable[[CameraFrame, float], Scene]


class PerceptionMeter:
    """What the network costs: CPU time of its thread and wall time, per frame."""

    def __init__(self) -> None:
        self.cpu_s = 0.0
        self.latencies_s: list[float] = []  # of every frame; it only grows

    def watch(self, observe: Observer) -> Observer:
        def observe_and_time(frame: CameraFrame, ready_s: float) -> Scene:
            started_s, cpu_started_s = time.monotonic(), time.thread_time()
            scene = observe(frame, ready_s)
            self.cpu_s += time.thread_time() - cpu_started_s
            self.latencies_s.append(time.monotonic() - started_s)
            return scene

        return observe_and_time

    @property
    def frames(self) -> int:
        return len(self.latencies_s)

    @property
    def frames_per_cpu_s(self) -> float | None:
        return self.frames / self.cpu_s if self.cpu_s else None

    @property
    def latency_p95_s(self) -> float | None:
        ordered = sorted(self.latencies_s)
        return ordered[int(0.95 * (len(ordered) - 1))] if ordered else None


class PerceptionHost(Protocol):
    @property
    def meter(self) -> PerceptionMeter | None: ...

    def step(self, batch: SensorBatch) -> tuple[Scene, ...]: ...

    def settle(self) -> None:
        """Wait until every frame taken so far has been looked at."""
        ...

    def close(self) -> None: ...


class NoPerception:
    """A robot without camera."""

    meter: PerceptionMeter | None = None

    def step(self, batch: SensorBatch) -> tuple[Scene, ...]:
        return ()

    def settle(self) -> None:
        pass

    def close(self) -> None:
        pass


class ThreadedPerception:
    """One worker thread runs `observe(frame, ready_s)`; the loop waits only for late results."""

    def __init__(self, observe: Observer, latency_s: float) -> None:
        self.meter = PerceptionMeter()
        self._observe = self.meter.watch(observe)
        self._latency_s = latency_s
        self._worker = ThreadPoolExecutor(max_workers=1, thread_name_prefix="perception")
        self._pending: deque[tuple[float, Future[Scene]]] = deque()

    def step(self, batch: SensorBatch) -> tuple[Scene, ...]:
        for frame in batch.frames:
            ready_s = frame.t_s + self._latency_s
            self._pending.append((ready_s, self._worker.submit(self._observe, frame, ready_s)))
        scenes: list[Scene] = []
        while self._pending and self._pending[0][0] <= batch.t_s + 1e-9:
            scenes.append(self._pending.popleft()[1].result())
        return tuple(scenes)

    def settle(self) -> None:
        wait([future for _, future in self._pending])

    def close(self) -> None:
        self._worker.shutdown(wait=True, cancel_futures=True)


class RecordedPerception:
    """The scenes of a recording, tick by tick, for a replay."""

    meter: PerceptionMeter | None = None

    def __init__(self, scenes_by_tick: Iterable[tuple[Scene, ...]]) -> None:
        self._scenes = iter(scenes_by_tick)

    def step(self, batch: SensorBatch) -> tuple[Scene, ...]:
        return next(self._scenes, ())

    def settle(self) -> None:
        pass

    def close(self) -> None:
        pass
