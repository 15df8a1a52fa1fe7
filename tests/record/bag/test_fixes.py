from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyproj import CRS, Transformer

from agribot.core.errors import RecordingError
from agribot.record.bag.convert import ConvertOptions, convert
from agribot.record.bag.definitions import ros1_store, ros2_store
from agribot.record.bag.opening import open_bag
from agribot.ros.messages import utm
from agribot.ros.messages.fixes import gpsfix_from_navsatfix, navsatfix_from_gpsfix
from tests.record.bag import bag_samples as samples

STORES = [(ros1_store(), False), (ros2_store(), True)]


@pytest.mark.parametrize(("store", "is_ros2"), STORES)
@pytest.mark.parametrize("status", [-1, 0, 1, 2])
@pytest.mark.parametrize("service", [0, 1, 4, 5])
def test_a_fix_survives_the_other_type(
    store: Any, is_ros2: bool, status: int, service: int
) -> None:
    fix = samples.nav_sat_fix(store, 12_500_000_000, status=status, service=service)
    back = navsatfix_from_gpsfix(gpsfix_from_navsatfix(fix, store, is_ros2), store)
    assert samples.plain(back) == samples.plain(fix)


def test_a_gpsfix_tells_errors_at_95_percent_and_its_time() -> None:
    store = ros2_store()
    fix = gpsfix_from_navsatfix(samples.nav_sat_fix(store, 12_500_000_000), store, True)
    assert fix.err_horz == pytest.approx(2.0 * math.sqrt(0.04 + 0.09))
    assert fix.err_vert == pytest.approx(2.0 * 0.4)
    assert fix.time == 12.5
    assert fix.status.satellites_used == 0
    unknown = samples.nav_sat_fix(store, 1)
    unknown.position_covariance_type = 0
    assert gpsfix_from_navsatfix(unknown, store, True).err_horz == 0.0


@pytest.mark.parametrize(("service", "source"), [(1, 1), (2, 1), (8, 1), (4, 16), (15, 17), (0, 0)])
def test_services_become_sources_as_in_the_original_translator(service: int, source: int) -> None:
    store = ros1_store()
    fix = samples.nav_sat_fix(store, 1, service=service)
    assert gpsfix_from_navsatfix(fix, store, False).status.position_source == source


@pytest.mark.parametrize(
    ("code", "expected"), [(18, 2), (33, 1), (19, 2), (20, 2), (-1, -1), (0, 0), (77, -1)]
)
def test_statuses_that_only_a_gpsfix_has_find_their_augmentation(code: int, expected: int) -> None:
    store = ros2_store()
    fix = gpsfix_from_navsatfix(samples.nav_sat_fix(store, 1), store, True)
    fix.status.status = code
    assert navsatfix_from_gpsfix(fix, store).status.status == expected


def test_a_bag_changes_its_fixes_and_changes_them_back(tmp_path: Path) -> None:
    samples.write_ros1(tmp_path / "a.bag")
    convert(tmp_path / "a.bag", tmp_path / "gps.mcap", ConvertOptions(fixes_as="gpsfix"))
    with open_bag(tmp_path / "gps.mcap") as bag:
        assert bag.find("/fix").ros_type == "gps_msgs/msg/GPSFix"
        assert bag.find("/text").ros_type == "std_msgs/msg/String"
    convert(tmp_path / "gps.mcap", tmp_path / "plain.bag")
    with open_bag(tmp_path / "plain.bag") as bag:  # only the package's name changes
        assert bag.find("/fix").ros_type == "gps_common/msg/GPSFix"
    convert(tmp_path / "plain.bag", tmp_path / "b.bag", ConvertOptions(fixes_as="navsatfix"))
    assert samples.values(tmp_path / "b.bag") == samples.values(tmp_path / "a.bag")


@given(lat_deg=st.floats(-79.9, 83.9), lon_deg=st.floats(-180.0, 179.999))
def test_utm_is_that_of_the_official_grid(lat_deg: float, lon_deg: float) -> None:
    zone = utm.find_zone(lat_deg, lon_deg)
    official = Transformer.from_crs(
        "EPSG:4326",
        CRS.from_epsg((32700 if zone.is_south else 32600) + zone.number),
        always_xy=True,
    )
    east_m, north_m = official.transform(lon_deg, lat_deg)
    assert utm.utm_from_geodetic(lat_deg, lon_deg, zone) == pytest.approx(
        (east_m, north_m), abs=1e-3
    )


@given(lat_deg=st.floats(-79.9, 83.9), lon_deg=st.floats(-180.0, 179.999))
def test_odometry_on_the_grid_leads_back_to_the_fix(lat_deg: float, lon_deg: float) -> None:
    store = ros2_store()
    fix = samples.nav_sat_fix(store, samples.START_NS, lat_deg, lon_deg)
    odometry = utm.odometry_from_fix(fix, store, append_zone=True)
    back = utm.fix_from_odometry(odometry, store)
    assert back.latitude == pytest.approx(lat_deg, abs=1e-8)
    assert math.remainder(back.longitude - lon_deg, 360.0) == pytest.approx(0.0, abs=1e-8)
    assert back.altitude == fix.altitude
    assert np.array_equal(back.position_covariance, fix.position_covariance)
    assert back.header.frame_id == fix.header.frame_id


@pytest.mark.parametrize(
    ("lat_deg", "lon_deg", "zone"),
    [
        (21.16, 72.79, "43N"), (-33.9, 151.2, "56S"), (60.4, 5.3, "32N"), (78.2, 15.6, "33N"),
        (0.0, 0.0, "31N"), (-1e-9, -180.0, "1S"), (10.0, 180.0, "1N"), (56.0, 2.9, "31N"),
    ],
)  # fmt: skip
def test_zones_follow_the_map_with_its_exceptions(
    lat_deg: float, lon_deg: float, zone: str
) -> None:
    assert str(utm.find_zone(lat_deg, lon_deg)) == zone
    assert utm.parse_zone(zone.lower()) == utm.find_zone(lat_deg, lon_deg)


def test_a_fix_without_position_or_time_gives_no_odometry() -> None:
    store = ros2_store()
    assert utm.odometry_from_fix(samples.nav_sat_fix(store, 0), store) is None
    assert utm.odometry_from_fix(samples.nav_sat_fix(store, 5, status=-1), store) is None
    assert utm.odometry_from_fix(samples.nav_sat_fix(store, 5, math.nan), store) is None


def test_odometry_says_that_it_knows_no_orientation() -> None:
    store = ros2_store()
    fix = samples.nav_sat_fix(store, 5)
    odometry = utm.odometry_from_fix(fix, store, frame_id="world", child_frame_id="rover")
    assert odometry is not None
    covariance = np.reshape(odometry.pose.covariance, (6, 6))
    assert np.diag(covariance)[3:].tolist() == [99999.0] * 3
    assert covariance[0, 1] == 0.01
    assert (odometry.header.frame_id, odometry.child_frame_id) == ("world", "rover")


@pytest.mark.parametrize("text", ["", "43", "61N", "0S", "N43", "43X"])
def test_what_is_no_zone_is_refused(text: str) -> None:
    with pytest.raises(RecordingError, match="43N"):
        utm.parse_zone(text)


def test_beyond_the_grid_and_without_a_zone_there_is_no_way() -> None:
    with pytest.raises(RecordingError, match="UTM ends"):
        utm.find_zone(85.0, 0.0)
    store = ros2_store()
    odometry = utm.odometry_from_fix(samples.nav_sat_fix(store, 5), store)
    with pytest.raises(RecordingError, match="does not say its UTM zone"):
        utm.fix_from_odometry(odometry, store)


def test_a_conversion_adds_the_grid_and_the_way_back(tmp_path: Path) -> None:
    samples.write_ros1(tmp_path / "a.bag")
    convert(tmp_path / "a.bag", tmp_path / "b.mcap", ConvertOptions(utm_of=("/fix",)))
    options = ConvertOptions(fix_of=("/fix/utm",))
    convert(tmp_path / "b.mcap", tmp_path / "c.mcap", options)
    found = samples.values(tmp_path / "c.mcap")
    for (_, before), (_, after) in zip(found["/fix"], found["/fix/utm/fix"], strict=True):
        assert after["latitude"] == pytest.approx(before["latitude"], abs=1e-8)
        assert after["longitude"] == pytest.approx(before["longitude"], abs=1e-8)
    with pytest.raises(RecordingError, match=r"/text is std_msgs/msg/String; this needs"):
        wrong = msgspec.structs.replace(options, fix_of=(), utm_of=("/text",))
        convert(tmp_path / "a.bag", tmp_path / "d.mcap", wrong)
