"""`gpsd-client` publishes what a real gpsd reports, and it goes over the UTM grid and back."""

from __future__ import annotations

import contextlib
import json
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest

from agribot.cli.main import main
from agribot.core.messages import GnssFix, GnssQuality, GnssStatus, Satellite
from agribot.drivers.gnss.gpsd_reader import GpsdReader
from agribot.ros.messages import rosmsg
from agribot.ros.messages.utm import find_zone
from agribot.ros.nodes.gps_umd import UtmOdometry, UtmSettings, UtmToNavSatFix
from agribot.ros.nodes.gpsd_client import ClientSettings, GpsdClient, GpsdReport
from agribot.ros.nodes.stage import EndlessStage
from tests import machine
from tests.drivers import receiver_bytes as written
from tests.drivers.gpsd_daemon import Daemon
from tests.drivers.lines import Line, free_port
from tests.drivers.test_real_gpsd import speak_nmea, speaking
from tests.waiting import wait_for

AT_S, NOW_S = 1_777_887_015.25, 1_777_887_100.5
FIX = GnssFix(
    t_s=0.0, lat_deg=52.15, lon_deg=4.51, alt_m=56.5, pos_std_m=0.3, quality=GnssQuality.RTK_FLOAT,
    velocity_mps=(0.3, 0.4, 0.0),
)  # fmt: skip
SEEN = GnssStatus(
    t_s=0.0, hdop=0.9,
    satellites=(
        Satellite(system="GP", number=5, elevation_deg=71.0, azimuth_deg=210.0, snr_db=44.0,
                  is_used=True),
    ),
)  # fmt: skip
TOLD = GpsdReport(AT_S, NOW_S, FIX, SEEN, is_accuracy_known=True)


@pytest.fixture
def line(tmp_path: Path) -> Iterator[Line]:
    line = Line(tmp_path)
    yield line
    line.unplug()


class Reports:
    """Reports without a gpsd."""

    def __init__(self, *reports: GpsdReport) -> None:
        self._waiting = list(reports)
        self.is_closed = False

    def take(self) -> Sequence[GpsdReport]:
        taken, self._waiting = self._waiting, []
        return taken

    def close(self) -> None:
        self.is_closed = True


def hear(stage: EndlessStage) -> dict[str, Any]:
    """What a node says in a tick, by topic; through the bytes of ROS 2, as on a network."""
    return {
        topic.name: rosmsg.load_types().deserialize_cdr(rosmsg.to_cdr(message), topic.ros_type)
        for topic, message in stage.tick(0.0)
    }


def stamp_s(message: Any) -> float:
    return float(message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec)


def test_a_fix_is_told_in_both_types_with_variances_in_square_metres_and_its_frame() -> None:
    stage = GpsdClient(Reports(TOLD), ClientSettings("antenna"), "/agribot/fix")
    said = hear(stage)
    assert list(said) == ["/extended_fix", "/agribot/fix"]
    for message in said.values():
        assert message.position_covariance[0] == pytest.approx(0.3**2)
        assert (message.latitude, message.longitude, message.altitude) == (52.15, 4.51, 56.5)
        assert message.header.frame_id == "antenna"
        assert stamp_s(message) == pytest.approx(AT_S, abs=1e-6)
    extended = said["/extended_fix"]
    assert extended.err_horz == pytest.approx(2.0 * math.sqrt(2.0) * 0.3)
    assert (extended.time, extended.hdop, extended.status.satellites_used) == (AT_S, 0.9, 1)
    assert stage.reason == ""


def test_without_gps_time_the_stamp_is_this_machines_and_the_time_still_the_receivers() -> None:
    said = hear(GpsdClient(Reports(TOLD), ClientSettings(use_gps_time=False)))
    assert {stamp_s(message) for message in said.values()} == {NOW_S}
    assert said["/extended_fix"].time == AT_S


@pytest.mark.parametrize("is_checked", [True, False])
def test_a_fix_whose_accuracy_nobody_tells_is_checked_or_told_as_such(is_checked: bool) -> None:
    settings = ClientSettings(check_fix_by_variance=is_checked)
    stage = GpsdClient(Reports(TOLD._replace(is_accuracy_known=False)), settings)
    said = hear(stage)
    assert ("/fix" in said) is not is_checked
    assert {message.position_covariance_type for message in said.values()} == {0}
    assert ("states no accuracy" in stage.reason) is is_checked


def test_while_the_receiver_searches_what_it_sees_is_told_and_no_place() -> None:
    reports = Reports(GpsdReport(0.0, NOW_S, None, SEEN))
    stage = GpsdClient(reports, ClientSettings())
    (extended,) = hear(stage).values()
    assert (extended.status.status, extended.status.satellites_visible) == (-1, 1)
    assert math.isnan(extended.latitude) and stamp_s(extended) == NOW_S
    assert stage.reason == "the receiver has no fix"
    stage.finish()
    assert reports.is_closed


@machine.needs("gpsd")
def test_a_real_gpsd_is_told_as_odometry_on_the_grid_that_leads_back(
    line: Line, tmp_path: Path
) -> None:
    with Daemon(tmp_path) as daemon:
        daemon.start(line.path)
        stage = GpsdClient(GpsdReader("127.0.0.1", daemon.port, pytest.fail), ClientSettings())
        grid, back = UtmOdometry(UtmSettings(append_zone=True)), UtmToNavSatFix(UtmSettings())
        try:
            with speaking((line, speak_nmea)):
                found = wait_for(lambda: _find_whole(stage), "a fix with satellites")
        finally:
            stage.finish()
    fix, extended = found["/fix"], found["/extended_fix"]
    assert (fix.latitude, fix.longitude) == pytest.approx(
        (written.LAT_DEG, written.LON_DEG), abs=2e-7
    )
    assert fix.position_covariance[0] == pytest.approx(0.02**2, rel=0.4)
    assert list(extended.status.satellite_used_prn) == [5, 7]
    assert stamp_s(fix) * 10.0 == pytest.approx(round(stamp_s(fix) * 10.0), abs=1e-4)
    ((_, odometry),) = grid.receive(grid.inputs[0], fix, 0.0)
    zone = find_zone(written.LAT_DEG, written.LON_DEG)
    assert odometry.header.frame_id.endswith(f"utm_{zone}"), zone
    ((_, again),) = back.receive(back.inputs[0], odometry, 0.0)
    assert (again.latitude, again.longitude) == pytest.approx(
        (fix.latitude, fix.longitude), abs=1e-8
    )


def _find_whole(stage: GpsdClient) -> dict[str, Any] | None:
    said = hear(stage)
    is_whole = "/fix" in said and said["/extended_fix"].status.satellites_visible == 2
    return said if is_whole else None


@machine.needs("gpsd")
def test_the_command_publishes_on_a_network_what_gpsd_tells(
    line: Line, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("zenoh")
    from agribot.ros.ros2.connection import Ros2Connection

    router, heard = f"tcp/127.0.0.1:{free_port()}", list[str]()
    with (
        Daemon(tmp_path) as daemon,
        contextlib.closing(Ros2Connection("peer", router=router, listen=True)) as peer,
    ):
        for name in ("/fix", "/extended_fix"):
            peer.subscribe_any(name, lambda kind, data: heard.append(kind))
        daemon.start(line.path)
        words = ["node", "gpsd-client", "--ros2", "--ros-router", router, "--host", "127.0.0.1",
                 "--port", str(daemon.port), "--for", "5", "--json"]  # fmt: skip
        with speaking((line, speak_nmea)):
            assert main(words) == 0
        wait_for(lambda: len(set(heard)) == 2, "a NavSatFix and a GPSFix")
    counts = json.loads(capsys.readouterr().out.splitlines()[-1])["messages"]
    assert counts["/extended_fix"] >= counts["/fix"] > 0


def test_where_no_gpsd_answers_that_is_said(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["node", "gpsd-client", "--ros2", "--port", str(free_port())]) == 2
    assert "gpsd localhost" in capsys.readouterr().err
