"""A sensor of a run is somebody else's topic: another process publishes it, or falls silent."""

from __future__ import annotations

import argparse
import threading
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any
from unittest.mock import ANY

import numpy as np
import pytest

from agribot.app.simulated_run import simulate
from agribot.cli.main import main
from agribot.cli.run import bridging, sensor_sources
from agribot.core import config
from agribot.core.facts import SourceHeard, SourceSilent
from agribot.core.geo import MapFrame
from agribot.core.messages import (
    GnssFix,
    GnssQuality,
    ImuSample,
    Inbox,
    RobotCommand,
    SensorBatch,
)
from agribot.core.platform import MixedPlatform
from agribot.description.loader import load_robot
from agribot.ros.messages import rosmsg
from agribot.ros.messages.rosmsg import load_types
from agribot.ros.messages.sensor_readers import make_readers
from agribot.ros.ros2 import wire
from agribot.ros.ros2.connection import Ros2Connection
from agribot.ros.topic_source import TopicSource
from tests.finding import holds
from tests.ros.live import Talk, first, free_port, zenoh_peer
from tests.waiting import wait_for

MARK = wire.pack_attachment(1, 0, b"g" * 16).hex()


def key_of(name: str, ros_type: str) -> str:
    return wire.make_topic_key(0, name, ros_type, load_types().hash_rihs01(ros_type))


def fix(lat_deg: float, lon_deg: float, stamp_s: float, alt_m: float = 0.0) -> Any:
    sample = GnssFix(
        t_s=stamp_s, lat_deg=lat_deg, lon_deg=lon_deg, alt_m=alt_m, pos_std_m=0.01,
        quality=GnssQuality.RTK_FIXED,
    )  # fmt: skip
    return rosmsg.make_fix(sample, "gps")


def publish(talk: Talk, name: str, message: Any, times: int = 1, rate_hz: float = 0.0) -> None:
    key = key_of(name, message.__msgtype__)
    talk("put", key, rosmsg.to_cdr(message).hex(), MARK, times, rate_hz)


class Ticks:
    """A platform that only ticks."""

    t_s = 0.0

    def __init__(self) -> None:
        self.inbox = Inbox()

    def read(self) -> SensorBatch:
        self.t_s += 0.02
        own = ImuSample(t_s=self.t_s, gyro_radps=(9.0, 9.0, 9.0), accel_mps2=(0.0, 0.0, 9.8))
        return SensorBatch(t_s=self.t_s, imu=(own,))

    def write(self, command: RobotCommand) -> None: ...

    def close(self) -> None: ...


class Played:
    sensor, name = "imu", "a list"

    def __init__(self, until_s: float, again_s: float) -> None:
        self._until_s, self._again_s = until_s, again_s

    def take(self, t_s: float) -> tuple[ImuSample, ...]:
        if self._until_s < t_s < self._again_s:
            return ()
        return (ImuSample(t_s=t_s, gyro_radps=(0.0, 0.0, 0.1), accel_mps2=(0.0, 0.0, 9.8)),)

    def close(self) -> None: ...


def test_a_source_replaces_the_platforms_own_samples_and_its_silence_is_told_once() -> None:
    source: Any = Played(1.0, 5.0)
    platform = MixedPlatform(Ticks(), [source])
    batches = [platform.read() for _ in range(350)]
    assert {sample.gyro_radps for b in batches for sample in b.imu} == {(0.0, 0.0, 0.1)}
    assert all(not b.imu for b in batches if 1.0 < b.t_s < 5.0)
    silent, heard = [note for b in batches for note in b.notes]
    assert silent.t_s == pytest.approx(3.0, abs=0.05)
    assert isinstance(silent.fact, SourceSilent)
    assert (silent.fact.parts, silent.fact.source) == (("imu",), "a list")
    assert heard.fact == SourceHeard("imu", "a list")


class Network:
    """Subscribers get each message at once."""

    def subscribe_any(self, name: str, heard: Callable[[str, bytes], None]) -> None:
        self.say = heard

    def decode(self, ros_type: str, data: bytes) -> Any:
        return load_types().deserialize_cdr(data, ros_type)


@pytest.mark.parametrize("ahead_s", [0.0, 7.0], ids=["the robot's clock", "another clock"])
@pytest.mark.parametrize("stood_s", [0.3, 1.5, 4.0])
def test_a_loop_that_stood_still_finds_every_sample_in_the_tick_of_its_capture(
    stood_s: float, ahead_s: float
) -> None:
    """Its clock goes on where it stopped, in a rush; the senders have gone on all the time."""
    network, now_s = Network(), 0.0
    known = make_readers("imu", load_robot("agribot"))
    source = TopicSource("imu", "/imu", network, known, pytest.fail, now_s=lambda: now_s)
    said, taken = 1, list[tuple[float, float]]()
    for tick in range(1, 500):
        now_s += 0.001 if (late_s := now_s - 0.02 * tick) > 0.0 else -late_s
        now_s += stood_s if tick == 200 else 0.0
        for index in range(said, int((now_s - 0.002) / 0.01 + 1e-9) + 1):
            moment_s, now_s = now_s, 0.01 * index + 0.002  # two milliseconds on the way
            sample = ImuSample(
                t_s=0.01 * index + ahead_s, gyro_radps=(0.0, 0.0, 0.1), accel_mps2=(0.0, 0.0, 9.8)
            )
            message = rosmsg.make_imu(sample, "imu")
            network.say(message.__msgtype__, rosmsg.to_cdr(message))
            now_s, said = moment_s, index + 1
        taken += [(0.02 * tick, got.t_s) for got in source.take(0.02 * tick)]
    at_s = np.array([captured_s for _, captured_s in taken])
    assert np.diff(at_s) == pytest.approx(np.full(len(at_s) - 1, 0.01), abs=1e-6)  # none is lost
    assert all(-1e-6 <= tick_s - captured_s <= 0.03 for tick_s, captured_s in taken)


def test_fixes_of_another_process_arrive_exactly_and_what_is_none_is_refused_by_name() -> None:
    locator, said = f"tcp/127.0.0.1:{free_port()}", list[str]()
    with closing(Ros2Connection("test", router=locator, listen=True)) as link:
        known = make_readers("gnss", load_robot("agribot"))
        source = TopicSource("gnss", "/fix", link, known, said.append, now_s=lambda: 50.1)
        with zenoh_peer(locator) as talk:
            publish(talk, "/fix", fix(21.25, 72.75, 50.0, 4.5))
            got: Any = first(lambda: source.take(50.1), "the fix")
            assert (got.lat_deg, got.lon_deg, got.alt_m) == (21.25, 72.75, 4.5)
            assert (got.t_s, got.quality) == (50.0, GnssQuality.RTK_FIXED)
            publish(talk, "/fix", fix(95.0, 72.75, 50.1))
            wait_for(lambda: any("no place on Earth" in text for text in said), "the refusal")
            publish(talk, "/fix", rosmsg.make_float64(1.0))
            wait_for(
                lambda: any("std_msgs/msg/Float64 is not read" in text for text in said), "that"
            )
            key = wire.make_topic_key(0, "/fix", "sensor_msgs/msg/NavSatFix", "RIHS01_00")
            talk("put", key, rosmsg.to_cdr(fix(1.0, 1.0, 1.0)).hex(), MARK)
            wait_for(lambda: any("of ROS 2 Jazzy" in text for text in said), "the other definition")
            talk("put", key_of("/fix", "sensor_msgs/msg/NavSatFix"), "00010000", MARK)
            wait_for(lambda: any("4 bytes are no" in text for text in said), "the stub")
    assert source.take(60.0) == ()


def test_the_robot_believes_to_be_where_another_process_says_and_its_silence_is_a_fault(
    tmp_path: Path,
) -> None:
    locator = f"tcp/127.0.0.1:{free_port()}"
    parser = argparse.ArgumentParser()
    sensor_sources.add_arguments(parser)
    bridging.add_arguments(parser)
    options = parser.parse_args(["--source", "gnss=ros2:/their/fix", "--ros-router", locator])
    assigned = [*sensor_sources.read_source_settings(options), "perception.enabled=false"]
    settings = config.load("farm", assigned)
    north_m = 0.8  # of where the simulated robot really stands
    with simulate(settings, tmp_path) as session:
        spawn = session.world.spawn_xy_map_m
        frame = MapFrame(settings.field.datum)
        lat_deg, lon_deg, _ = frame.geodetic_from_map(spawn[0], spawn[1] + north_m)
        with (
            sensor_sources.open_sensor_sources(options, session),
            zenoh_peer(locator) as talk,
        ):
            message = fix(lat_deg, lon_deg, 0.0, settings.field.datum.alt_m)
            speaker = threading.Thread(
                target=publish, args=(talk, "/their/fix", message, 30, 10.0), daemon=True
            )
            speaker.start()
            seen: list[GnssFix] = []
            pace_s = time.monotonic()
            for record in session.ticks():
                seen.extend(record.batch.gnss)
                time.sleep(max(0.0, pace_s + record.batch.t_s - time.monotonic()))
                if session.event_log.list_kind("fault") or record.batch.t_s > 60.0:
                    break
            speaker.join()
            assert session.last is not None
        faults = [event.fact for event in session.event_log.list_kind("fault")]
    assert seen
    assert {(sample.lat_deg, sample.lon_deg) for sample in seen} == {(lat_deg, lon_deg)}
    assert any(holds(fault, SourceSilent("gnss", "/their/fix", ANY, ANY)) for fault in faults)


def test_what_is_no_topic_is_refused_before_anything_starts(
    capsys: pytest.CaptureFixture[str],
) -> None:
    for wrong, why in (
        ("gnss=usb:/dev/ttyUSB0", "write gnss=ros2:/topic"),
        ("gnss=ros2:", "write gnss=ros2:/topic"),
        ("ros2:/fix", "--source ros2:/fix: no URI; write SENSOR=URI"),
        ("gpss=ros2:/fix", "did you mean 'gnss'"),
    ):
        assert main(["run", "farm", "--source", wrong]) == 2
        assert why in capsys.readouterr().err
