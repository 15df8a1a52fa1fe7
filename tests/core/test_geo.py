"""Places and angles, against PROJ and against geometry."""

from __future__ import annotations

import math

import numpy as np
import pyproj
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agribot.core.geo import (
    LINK_FROM_OPTICAL,
    AlvinXY,
    Datum,
    MapFrame,
    compass_deg_from_yaw,
    ecef_from_geodetic,
    geodetic_from_ecef,
    inverse,
    make_datum,
    rotation_from_rpy,
    transform,
    wrap_rad,
    yaw_from_compass_deg,
)
from agribot.core.messages import FloatArray

DATUMS = [
    Datum(lat_deg=lat, lon_deg=lon, alt_m=120.0)
    for lat, lon in (
        (21.161289, 72.787022),
        (0.0, 0.0),
        (52.0, 5.0),
        (-33.9, 18.4),
        (69.6, 18.9),
        (-17.0, 179.9999),
        (-17.0, -179.9999),
        (65.0, 180.0),
        (89.9, 30.0),
    )
]
SURAT = DATUMS[0]
angles = st.floats(-1e3, 1e3)


def places(reach_m: float, count: int = 40) -> FloatArray:
    rng = np.random.default_rng(4)
    scale = np.array([reach_m, reach_m, 50.0])
    drawn: FloatArray = rng.uniform(-1.0, 1.0, (count, 3)) * scale
    return drawn


def ring(radius_m: float) -> FloatArray:
    angle = np.linspace(0.0, math.tau, 72, endpoint=False)
    return np.column_stack([radius_m * np.cos(angle), radius_m * np.sin(angle)])


def alvin_error_m(lat_deg: float, radius_m: float) -> float:
    """Worst distance between AlvinXY and the exact map on a circle around the datum."""
    datum = Datum(lat_deg=lat_deg, lon_deg=72.787022)
    frame, alvin = MapFrame(datum), AlvinXY(datum)
    worst_m = 0.0
    for east_m, north_m in ring(radius_m):
        lat, lon, _ = frame.geodetic_from_map(float(east_m), float(north_m))
        x_m, y_m, _ = frame.map_from_geodetic(lat, lon, 0.0)
        worst_m = max(worst_m, math.dist((x_m, y_m), alvin.xy_from_geodetic(lat, lon)))
    return worst_m


@pytest.mark.parametrize("datum", DATUMS, ids=str)
def test_the_map_agrees_with_proj_to_a_micrometre_within_five_kilometres(datum: Datum) -> None:
    topocentric = pyproj.Transformer.from_pipeline(
        "+proj=pipeline +step +proj=cart +ellps=WGS84 +step +proj=topocentric +ellps=WGS84 "
        f"+lat_0={datum.lat_deg} +lon_0={datum.lon_deg} +h_0={datum.alt_m}"
    )
    frame = MapFrame(datum)
    for east_m, north_m, up_m in places(5000.0):
        lat, lon, alt = frame.geodetic_from_map(east_m, north_m, up_m)
        theirs = topocentric.transform(lon, lat, alt)
        assert frame.map_from_geodetic(lat, lon, alt) == pytest.approx(theirs, abs=1e-6)


@pytest.mark.parametrize("datum", DATUMS, ids=str)
def test_map_to_geodetic_and_back_is_the_same_place(datum: Datum) -> None:
    frame = MapFrame(datum)
    for place in places(5000.0):
        there = frame.geodetic_from_map(*place)
        assert frame.map_from_geodetic(*there) == pytest.approx(tuple(place), abs=1e-6)
        again = frame.geodetic_from_map(*frame.map_from_geodetic(*there))
        assert again[:2] == pytest.approx(there[:2], abs=1e-9, rel=0)


def test_the_datum_is_the_origin() -> None:
    place = MapFrame(SURAT).map_from_geodetic(SURAT.lat_deg, SURAT.lon_deg, SURAT.alt_m)
    assert place == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)


def test_a_place_without_an_altitude_lies_on_the_height_of_the_map() -> None:
    frame = MapFrame(make_datum(48.0, 11.0, 1700.0))
    assert frame.map_from_geodetic(48.004, 11.0, math.nan) == frame.map_from_geodetic(
        48.004, 11.0, 1700.0
    )
    assert make_datum(48.0, 11.0, math.nan).alt_m == 0.0


def test_east_is_east_north_is_north_and_up_is_up() -> None:
    frame = MapFrame(SURAT)
    east = frame.map_from_geodetic(SURAT.lat_deg, SURAT.lon_deg + 1e-3, SURAT.alt_m)
    north = frame.map_from_geodetic(SURAT.lat_deg + 1e-3, SURAT.lon_deg, SURAT.alt_m)
    up = frame.map_from_geodetic(SURAT.lat_deg, SURAT.lon_deg, SURAT.alt_m + 10.0)
    assert east == pytest.approx((103.9, 0.0, 0.0), abs=0.1)
    assert north == pytest.approx((0.0, 110.7, 0.0), abs=0.1)
    assert up == pytest.approx((0.0, 0.0, 10.0), abs=1e-6)


def test_without_an_altitude_a_place_is_as_far_as_at_that_of_the_datum() -> None:
    datum = make_datum(49.5, 8.1, 1700.0)
    frame = MapFrame(datum)
    known, unknown = (frame.map_from_geodetic(49.5045, 8.1, alt_m) for alt_m in (1700.0, math.nan))
    assert unknown == known and known[1] == pytest.approx(500.6, abs=0.1)
    at_sea = MapFrame(make_datum(49.5, 8.1, math.nan)).map_from_geodetic(49.5045, 8.1, math.nan)
    assert known[1] - at_sea[1] == pytest.approx(0.13, abs=0.01)


def test_a_field_across_the_antimeridian_is_in_one_piece() -> None:
    frame = MapFrame(Datum(lat_deg=-17.0, lon_deg=179.9999))
    east_m, _, _ = frame.map_from_geodetic(-17.0, -179.9999, 0.0)
    assert east_m == pytest.approx(21.3, abs=0.1)
    _, lon, _ = frame.geodetic_from_map(21.3, 0.0)
    assert lon == pytest.approx(-179.9999, abs=1e-6)


def test_ecef_agrees_with_proj_everywhere() -> None:
    cart = pyproj.Transformer.from_pipeline("+proj=cart +ellps=WGS84")
    rng = np.random.default_rng(1)
    for _ in range(300):
        lat, lon = float(rng.uniform(-90, 90)), float(rng.uniform(-180, 180))
        alt = float(rng.uniform(-1e4, 1e4))
        ecef = ecef_from_geodetic(lat, lon, alt)
        np.testing.assert_allclose(ecef, cart.transform(lon, lat, alt), rtol=0, atol=1e-7)
        back = geodetic_from_ecef(ecef)
        assert back[0] == pytest.approx(lat, abs=1e-12)
        assert math.remainder(back[1] - lon, 360.0) == pytest.approx(0.0, abs=1e-9)
        assert back[2] == pytest.approx(alt, abs=1e-8)


@pytest.mark.parametrize("lat_deg", [90.0, -90.0])
def test_the_poles_are_places_too(lat_deg: float) -> None:
    assert geodetic_from_ecef(ecef_from_geodetic(lat_deg, 0.0, 5.0))[::2] == pytest.approx(
        (lat_deg, 5.0)
    )


@pytest.mark.parametrize(
    ("lat_deg", "radius_m", "error_mm"),
    [
        (21.161289, 100.0, 4.9),
        (21.161289, 1000.0, 65.1),
        (21.161289, 5000.0, 1016.0),
        (60.0, 1000.0, 178.0),
    ],
)
def test_alvin_xy_is_off_the_exact_map_by_what_its_docstring_says(
    lat_deg: float, radius_m: float, error_mm: float
) -> None:
    assert alvin_error_m(lat_deg, radius_m) * 1e3 == pytest.approx(error_mm, rel=0.01)


def test_alvin_xy_round_trip_is_exact_on_both_sides_of_the_antimeridian() -> None:
    for datum in DATUMS[:-1]:
        alvin = AlvinXY(datum)
        for x_m, y_m, _ in places(3000.0):
            lat, lon = alvin.geodetic_from_xy(x_m, y_m)
            assert -180.0 <= lon <= 180.0
            assert alvin.xy_from_geodetic(lat, lon) == pytest.approx((x_m, y_m), abs=1e-6)


def test_alvin_xy_gives_the_metres_per_degree_of_the_original_nodes() -> None:
    """Values of the published series, evaluated by hand for 45 degrees."""
    alvin = AlvinXY(Datum(lat_deg=45.0, lon_deg=10.0))
    x_m, y_m = alvin.xy_from_geodetic(46.0, 11.0)
    root = math.sqrt(0.5)
    assert y_m == pytest.approx(111132.09 - 1.20, abs=1e-6)
    assert x_m == pytest.approx((111415.13 + 94.55 - 0.12) * root, abs=1e-6)


@given(angles)
def test_a_wrapped_angle_is_the_same_direction_within_half_a_turn(angle: float) -> None:
    wrapped = wrap_rad(angle)
    assert -math.pi < wrapped <= math.pi
    assert math.cos(wrapped) == pytest.approx(math.cos(angle), abs=1e-9)
    assert math.sin(wrapped) == pytest.approx(math.sin(angle), abs=1e-9)


@pytest.mark.parametrize("turns", [-3, -1, 1, 3])
def test_half_a_turn_is_always_plus_pi(turns: int) -> None:
    assert wrap_rad(turns * math.pi) == math.pi


@pytest.mark.parametrize(
    ("compass_deg", "yaw_rad"),
    [
        (0.0, math.pi / 2),
        (90.0, 0.0),
        (180.0, -math.pi / 2),
        (270.0, math.pi),
        (45.0, math.pi / 4),
        (315.0, 3 * math.pi / 4),
    ],
)
def test_compass_and_yaw_of_the_winds(compass_deg: float, yaw_rad: float) -> None:
    assert yaw_from_compass_deg(compass_deg) == pytest.approx(yaw_rad)
    assert compass_deg_from_yaw(yaw_rad) == pytest.approx(compass_deg)


@pytest.mark.parametrize("yaw_rad", [math.pi / 2, math.nextafter(math.pi / 2, 4.0)])
def test_north_is_zero_and_never_360(yaw_rad: float) -> None:
    assert compass_deg_from_yaw(yaw_rad) == pytest.approx(0.0, abs=1e-9)


@given(st.floats(-720.0, 720.0))
def test_compass_to_yaw_and_back_is_the_same_heading(compass_deg: float) -> None:
    yaw_rad = yaw_from_compass_deg(compass_deg)
    back_deg = compass_deg_from_yaw(yaw_rad)
    assert -math.pi < yaw_rad <= math.pi
    assert 0.0 <= back_deg < 360.0
    assert math.remainder(back_deg - compass_deg, 360.0) == pytest.approx(0.0, abs=1e-9)


@given(angles, angles, angles)
def test_a_rotation_keeps_lengths_and_handedness(roll: float, pitch: float, yaw: float) -> None:
    rotation = rotation_from_rpy(roll, pitch, yaw)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1.0)


def test_roll_pitch_yaw_are_about_the_fixed_axes_in_this_order() -> None:
    roll, pitch, yaw = 0.3, -0.5, 1.1
    chain = (
        rotation_from_rpy(0, 0, yaw)
        @ rotation_from_rpy(0, pitch, 0)
        @ rotation_from_rpy(roll, 0, 0)
    )
    np.testing.assert_allclose(rotation_from_rpy(roll, pitch, yaw), chain, atol=1e-15)
    np.testing.assert_allclose(
        rotation_from_rpy(math.pi / 2, 0, 0) @ [0, 1, 0], [0, 0, 1], atol=1e-15
    )
    np.testing.assert_allclose(
        rotation_from_rpy(0, math.pi / 2, 0) @ [0, 0, 1], [1, 0, 0], atol=1e-15
    )
    np.testing.assert_allclose(
        rotation_from_rpy(0, 0, math.pi / 2) @ [1, 0, 0], [0, 1, 0], atol=1e-15
    )


def test_a_transform_times_its_inverse_is_nothing() -> None:
    parent_from_child = transform((1.0, -2.0, 0.5), (0.3, -0.2, 2.0))
    np.testing.assert_allclose(
        parent_from_child @ inverse(parent_from_child), np.eye(4), atol=1e-15
    )
    np.testing.assert_allclose(
        inverse(parent_from_child), np.linalg.inv(parent_from_child), atol=1e-14
    )


def test_the_optical_axes_lie_in_the_link_as_rep_103_says() -> None:
    """Right in the image is -y of the link, down is -z, and the view goes along x."""
    axes = LINK_FROM_OPTICAL[:3, :3]
    np.testing.assert_allclose(axes @ [1, 0, 0], [0, -1, 0], atol=1e-15)
    np.testing.assert_allclose(axes @ [0, 1, 0], [0, 0, -1], atol=1e-15)
    np.testing.assert_allclose(axes @ [0, 0, 1], [1, 0, 0], atol=1e-15)
