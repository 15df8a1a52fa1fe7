"""The nodes of gps_umd say what the original's said, to the millimetre, without any network."""

from __future__ import annotations

import contextlib
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyproj import Transformer

from agribot.cli.run.node_runner import NodeRunner
from agribot.core.messages import GnssFix, GnssQuality
from agribot.ros.messages import rosmsg
from agribot.ros.messages.utm import UtmZone
from agribot.ros.nodes import gps_umd
from agribot.ros.nodes.gps_umd import FixTranslator, UtmOdometry, UtmSettings, UtmToNavSatFix
from agribot.ros.nodes.stage import NodeStage
from tests.ros.live import free_port
from tests.waiting import wait_for


def make_fix(lat_deg: float = 21.16, lon_deg: float = 72.79, t_s: float = 5.0) -> Any:
    fix = GnssFix(
        t_s=t_s, lat_deg=lat_deg, lon_deg=lon_deg, alt_m=4.5, pos_std_m=0.5,
        quality=GnssQuality.DGNSS,
    )  # fmt: skip
    return rosmsg.make_fix(fix, "gps")


def say(stage: Any, message: Any, index: int = 0) -> Any:
    """What the node answers; through the bytes of ROS 2, as on a network."""
    said = stage.receive(stage.inputs[index], message, 0.0)
    if not said:
        return None
    ((topic, answer),) = said
    return rosmsg.load_types().deserialize_cdr(rosmsg.to_cdr(answer), topic.ros_type)


def test_the_translator_turns_either_fix_into_the_other_and_back() -> None:
    fix, stage = make_fix(), FixTranslator()
    gps = say(stage, fix)
    assert (gps.latitude, gps.status.position_source) == (21.16, 1)
    assert gps.err_horz == pytest.approx(2.0 * 2.0**0.5 * 0.5)
    back = say(stage, gps, 1)
    assert rosmsg.to_cdr(back) == rosmsg.to_cdr(fix)
    assert [topic.name for topic in (*stage.inputs, *stage.outputs)] == [
        "/navsat_fix_in", "/gps_fix_in", "/gps_fix_out", "/navsat_fix_out",
    ]  # fmt: skip
    assert gps_umd.GPS_IN.seed_ros_type == "gps_common/msg/GPSFix"


@given(st.floats(-79.0, 83.0), st.floats(72.01, 77.99))
def test_odometry_is_that_of_the_official_grid_and_leads_back(
    lat_deg: float, lon_deg: float
) -> None:
    odometry = say(UtmOdometry(UtmSettings(append_zone=True)), make_fix(lat_deg, lon_deg))
    code = (32700 if lat_deg < 0.0 else 32600) + 43
    east_m, north_m = Transformer.from_crs("EPSG:4326", code, always_xy=True).transform(
        lon_deg, lat_deg
    )
    place = odometry.pose.pose.position
    assert (place.x, place.y) == pytest.approx((east_m, north_m), abs=1e-3)
    back = say(UtmToNavSatFix(UtmSettings()), odometry)
    assert (back.latitude, back.longitude) == pytest.approx((lat_deg, lon_deg), abs=1e-8)
    assert back.header.frame_id == "gps"


def test_the_parameters_of_the_original_are_kept() -> None:
    settings = UtmSettings("world", "rover", rot_covariance=7.0, zone=UtmZone(44))
    stage = UtmOdometry(settings, "/agribot/fix", "/utm")
    assert (stage.inputs[0].name, stage.outputs[0].name) == ("/agribot/fix", "/utm")
    odometry = say(stage, make_fix())
    assert (odometry.header.frame_id, odometry.child_frame_id) == ("world", "rover")
    covariance = np.reshape(odometry.pose.covariance, (6, 6))
    assert np.diag(covariance).tolist() == [0.25, 0.25, 1.0, 7.0, 7.0, 7.0]
    assert odometry.pose.pose.position.x < 0.0  # of the zone in the west
    back = UtmToNavSatFix(UtmSettings(zone=UtmZone(44)))
    assert say(back, odometry).longitude == pytest.approx(72.79, abs=1e-8)


def test_a_robot_that_crosses_into_another_zone_makes_no_step() -> None:
    stage = UtmOdometry(UtmSettings())
    west, east = (say(stage, make_fix(lon_deg=78.0 + d)) for d in (-1e-5, 1e-5))
    assert abs(east.pose.pose.position.x - west.pose.pose.position.x) < 3.0


def test_no_fix_no_stamp_and_no_zone_are_told_and_left_out() -> None:
    stage = UtmOdometry(UtmSettings())
    lost = make_fix()
    lost.status.status = -1
    for fix in (lost, make_fix(t_s=0.0)):
        assert say(stage, fix) is None and "no fix, or no stamp" in stage.reason
    assert say(UtmOdometry(UtmSettings()), make_fix(lat_deg=85.0)) is None
    odometry = say(UtmOdometry(UtmSettings()), make_fix())
    back = UtmToNavSatFix(UtmSettings())
    assert say(back, odometry) is None and "does not say its UTM zone" in back.reason


def test_over_a_network_a_fix_goes_through_translator_and_grid_and_comes_back() -> None:
    pytest.importorskip("zenoh")
    from agribot.ros.ros2.connection import Ros2Connection

    router = f"tcp/127.0.0.1:{free_port()}"
    fix_topic, heard = gps_umd.NAVSAT_IN, list[tuple[str, bytes]]()
    settings = UtmSettings(append_zone=True)
    stages: tuple[NodeStage, ...] = (
        UtmOdometry(settings, fix_topic.name, "/odom"),
        UtmToNavSatFix(UtmSettings(), "/odom", "/fix_again"),
        FixTranslator(),
    )
    with contextlib.ExitStack() as links:

        def join(name: str, *, listen: bool = False) -> Ros2Connection:
            return links.enter_context(
                contextlib.closing(Ros2Connection(name, router=router, listen=listen))
            )

        peer = join("peer", listen=True)
        peer.advertise(fix_topic)
        for name in ("/fix_again", "/gps_fix_out"):
            peer.subscribe_any(name, lambda kind, data: heard.append((kind, data)))
        runners = [
            NodeRunner(stage, join(f"node{k}"), pytest.fail if k == 2 else lambda text: None)
            for k, stage in enumerate(stages)
        ]

        def hear_both() -> bool:
            peer.publish(fix_topic, rosmsg.to_cdr(make_fix()))
            for runner in runners:
                runner.step()
            return len({kind for kind, _ in heard}) == 2

        wait_for(hear_both, "a fix and a GPSFix")
    for kind, data in heard:
        answer: Any = rosmsg.load_types().deserialize_cdr(data, kind)
        assert (answer.latitude, answer.longitude) == pytest.approx((21.16, 72.79), abs=1e-8)
