"""Where frames meet the network: off the control loop, in the order they were captured.

A host takes the frames of a batch and hands back the scenes that are usable by now. In a simulation
the scene of a frame becomes usable a fixed `latency_s` after its capture, and time stands still
until it is there: the loop never sees a result earlier or later because of a busy core, so a run
repeats bit by bit. On a real robot a scene is used as soon as it is there, the loop waits for
nothing, the newest frame wins, and `latency_s` is what pictures are late against.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Iterable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from typing import Protocol

from agribot.core.messages import CameraFrame, Scene, SensorBatch

Observer = Callable[[CameraFrame, float], Scene]
SETTLE_S = 2.0


class PerceptionMeter:
    """Cost of the network: CPU time of its thread and wall time, per frame."""

    def __init__(self) -> None:
        self.cpu_s = 0.0
        self.latencies_s: list[float] = []  # latency of every frame; it only grows

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
    def latency_p95_s(self) -> float | None:
        ordered = sorted(self.latencies_s)
        return ordered[int(0.95 * (len(ordered) - 1))] if ordered else None


class PerceptionHost(Protocol):
    @property
    def meter(self) -> PerceptionMeter | None: ...

    def step(self, batch: SensorBatch) -> tuple[Scene, ...]: ...

    def settle(self) -> None:
        """Wait until every frame taken has been looked at."""
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
    """One worker thread runs `observe(frame, ready_s)`; the loop waits for late results."""

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


class NewestPerception:
    """One thread looks at the newest frame; those that it has no time for are dropped.

    A scene comes out in the first tick in which it is there, and the recording knows that tick. A
    hanging network does not block the loop.
    """

    def __init__(self, observe: Observer, latency_s: float) -> None:
        self.meter = PerceptionMeter()
        self._observe = self.meter.watch(observe)
        self._latency_s = latency_s
        self._changed = threading.Condition()
        self._waiting: CameraFrame | None = None
        self._is_busy = self._is_closed = False
        self._seen: deque[Scene] = deque()
        self._fault: Exception | None = None
        self.dropped = 0
        self._thread = threading.Thread(target=self._run, name="perception", daemon=True)
        self._thread.start()

    def step(self, batch: SensorBatch) -> tuple[Scene, ...]:
        """Take the frames and give the scenes that are there; an error of the network comes out."""
        with self._changed:
            for frame in batch.frames:
                self.dropped += self._waiting is not None
                self._waiting = frame
                self._changed.notify_all()
            if self._fault is not None:
                raise self._fault
            scenes = tuple(self._seen)
            self._seen.clear()
        return scenes

    def settle(self) -> None:
        """Wait for the newest frame, but not for a network that hangs."""
        with self._changed:
            self._changed.wait_for(
                lambda: not (self._is_busy or self._waiting) or self._fault, SETTLE_S
            )

    def close(self) -> None:
        with self._changed:
            self._is_closed = True
            self._changed.notify_all()
        self._thread.join(SETTLE_S)

    def _run(self) -> None:
        while (frame := self._take()) is not None:
            try:
                scene = self._observe(frame, frame.t_s + self._latency_s)
            except Exception as error:  # noqa: BLE001 - it belongs to the loop, which raises it
                with self._changed:
                    self._fault, self._is_busy = error, False
                    self._changed.notify_all()
                return
            with self._changed:
                self._seen.append(scene)
                self._is_busy = False
                self._changed.notify_all()

    def _take(self) -> CameraFrame | None:
        """Wait for a frame; None at the end."""
        with self._changed:
            self._changed.wait_for(lambda: self._waiting is not None or self._is_closed)
            frame, self._waiting = self._waiting, None
            self._is_busy = frame is not None and not self._is_closed
            return None if self._is_closed else frame


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
