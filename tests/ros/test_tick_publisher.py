"""A bridge that stalls or fails costs its listeners, never the control loop."""

from __future__ import annotations

import threading

from agribot.core import topics
from agribot.core.errors import BridgeError
from agribot.core.geo import Datum
from agribot.core.messages import TickRecord
from agribot.core.topics import Topic
from agribot.ros.messages.camera_log import CameraLog
from agribot.ros.tick_publisher import QUEUE_TICKS, Gateway, RunSources, TickPublisher
from tests.record import record_samples as samples
from tests.waiting import wait_for

DATUM = Datum(lat_deg=21.161289, lon_deg=72.787022, alt_m=4.5)


class Sink:
    """Notes the times of the clock; waits at a gate, or fails."""

    def __init__(self, *, fails: bool = False) -> None:
        self.gate, self.clocks, self.fails, self.closed = threading.Event(), [0][:0], fails, False

    def publish(self, topic: Topic, _data: bytes, t_ns: int) -> None:
        if self.fails:
            raise BridgeError("the peer is gone")
        self.gate.wait()
        if topic is topics.CLOCK:
            self.clocks.append(t_ns)

    def step(self, _record: TickRecord) -> None:
        pass

    def close(self) -> None:
        self.closed = True


def outlet_to(*gateways: Gateway) -> TickPublisher:
    robot = samples.robot()
    return TickPublisher(
        gateways, robot, DATUM, samples.URDF, CameraLog(robot, 0.0, 80), RunSources(lambda: None)
    )


def test_a_stalled_gateway_loses_the_oldest_ticks_and_blocks_nobody() -> None:
    sink = Sink()
    outlet = outlet_to(sink)
    records = samples.ticks(200)
    for record in records:
        outlet(record)  # returns although the gate is shut, or this test never ends
    assert outlet.dropped >= 200 - QUEUE_TICKS - 1
    sink.gate.set()
    wait_for(lambda: len(sink.clocks) >= QUEUE_TICKS, "the newest ticks")
    outlet.close()
    newest = [round(record.batch.t_s * 1e9) for record in records[-QUEUE_TICKS:]]
    assert sink.clocks[-QUEUE_TICKS:] == newest
    assert sink.closed


def test_a_gateway_that_fails_is_named_and_leaves_the_others_alone() -> None:
    broken, whole = Sink(fails=True), Sink()
    whole.gate.set()
    outlet = outlet_to(broken, whole)
    for record in samples.ticks(10):
        outlet(record)
    outlet.close()
    assert len(whole.clocks) == 10
    assert outlet.fault == "the peer is gone"


def test_a_clock_that_jumps_back_is_passed_on_and_harms_nothing() -> None:
    sink = Sink()
    sink.gate.set()
    outlet = outlet_to(sink)
    records = samples.ticks(20)
    for record in [*records, *records[:5]]:
        outlet(record)
    outlet.close()
    assert sink.clocks[-5:] == sink.clocks[:5]
    assert outlet.fault == ""
