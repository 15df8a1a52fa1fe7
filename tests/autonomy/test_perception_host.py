"""Frames meet the network beside the control loop, and the loop sees the scenes at fixed times."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest

from agribot.autonomy.perception_host import NewestPerception, ThreadedPerception
from agribot.core.messages import CameraFrame, Scene, SensorBatch
from tests.record import record_samples as samples
from tests.waiting import wait_for

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


def wait_until(host: NewestPerception, t_s: float) -> tuple[Scene, ...]:
    """What comes out at that time, as soon as the network is through."""
    return wait_for(lambda: host.step(batch(t_s)), "a scene")


def test_where_time_goes_on_the_newest_frame_wins_and_the_loop_waits_for_none(
    network: SlowNetwork,
) -> None:
    host = NewestPerception(network, LATENCY_S)
    assert host.step(batch(1.00, 0)) == ()
    wait_for(lambda: host._is_busy, "the first frame to be taken")
    for index in range(1, 40):  # the network hangs: every tick comes at once
        assert host.step(batch(1.0 + index / 10.0, index)) == ()
    network.let.release(2)
    seen = [*wait_until(host, 5.0)]
    seen += [] if len(seen) == 2 else wait_until(host, 5.0)
    assert [scene.frame_index for scene in seen] == [0, 39]
    assert host.dropped == 38
    host.step(batch(6.00, 40))
    network.let.release(1)
    host.settle()
    assert [scene.frame_index for scene in host.step(batch(6.02))] == [40], "as soon as it is there"
    assert host.step(batch(6.04)) == ()
    host.close()


def test_a_network_that_hangs_keeps_no_program_from_ending(network: SlowNetwork) -> None:
    host = NewestPerception(network, LATENCY_S)
    host.step(batch(1.00, 0))
    host.settle()
    host.close()
    network.let.release(100)


def test_a_network_that_fails_tells_so_where_nobody_waits_for_it(network: SlowNetwork) -> None:
    host = NewestPerception(network, LATENCY_S)
    network.let.release(1)
    host.step(batch(1.00, 13))
    host.settle()
    with pytest.raises(ArithmeticError, match="no such picture"):
        host.step(batch(1.10))
    host.close()
