"""Frames meet the network beside the control loop, and the loop sees the scenes at fixed times."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest

from agribot.autonomy.perception_host import ThreadedPerception
from agribot.core.messages import CameraFrame, Scene, SensorBatch
from tests.record import record_samples as samples

LATENCY_S = 0.10


class SlowNetwork:
    """Looks at a frame only when it is let."""

    def __init__(self) -> None:
        self.let = threading.Semaphore(0)
        self.seen: list[int] = []

    def __call__(self, frame: CameraFrame, ready_s: float) -> Scene:
        self.let.acquire()
        if frame.index == 13:
            raise ArithmeticError("no such picture")
        self.seen.append(frame.index)
        return samples.scene(frame.index, ready_s)


@pytest.fixture
def network() -> SlowNetwork:
    return SlowNetwork()


@pytest.fixture
def host(network: SlowNetwork) -> Iterator[ThreadedPerception]:
    host = ThreadedPerception(network, LATENCY_S)
    yield host
    network.let.release(100)
    host.close()


def batch(t_s: float, *frames: int) -> SensorBatch:
    return SensorBatch(t_s=t_s, frames=tuple(samples.frame(index, t_s) for index in frames))


def later(network: SlowNetwork, frames: int) -> threading.Timer:
    timer = threading.Timer(0.1, network.let.release, (frames,))
    timer.start()
    return timer


def test_a_scene_is_usable_a_latency_after_its_capture_however_fast_the_network(
    host: ThreadedPerception, network: SlowNetwork
) -> None:
    network.let.release(3)
    assert host.step(batch(1.00, 0)) == ()
    host.settle()
    assert network.seen == [0]
    assert host.step(batch(1.08, 1)) == ()
    (scene,) = host.step(batch(1.10))
    assert scene.frame_index == 0
    assert scene.ready_s == pytest.approx(1.10)


def test_the_loop_waits_for_a_scene_that_is_due_and_gets_them_in_order(
    host: ThreadedPerception, network: SlowNetwork
) -> None:
    host.step(batch(1.00, 0, 1))
    timer = later(network, 2)
    assert [scene.frame_index for scene in host.step(batch(1.10))] == [0, 1]
    timer.join()
    assert host.meter.frames == 2


def test_settling_waits_for_every_frame_taken_and_gives_none_out(
    host: ThreadedPerception, network: SlowNetwork
) -> None:
    host.step(batch(1.00, 0, 1, 2))
    timer = later(network, 3)
    host.settle()
    timer.join()
    assert network.seen == [0, 1, 2]
    assert len(host.step(batch(1.10))) == 3


def test_a_network_that_fails_tells_so_when_its_scene_is_due(
    host: ThreadedPerception, network: SlowNetwork
) -> None:
    network.let.release(1)
    host.step(batch(1.00, 13))
    host.settle()
    with pytest.raises(ArithmeticError, match="no such picture"):
        host.step(batch(1.10))
