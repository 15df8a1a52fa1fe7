"""What users of other programs reported as going wrong there is read as it is meant here.

The constructs of public bug reports, rebuilt in small files: `bug-inputs` in the folder that
AGRIBOT_DATA names. Files of many more forms are made by the tests of each reader.
"""

from __future__ import annotations

import json
import math
import os
import shutil
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path
from typing import NamedTuple, TypeVar
from unittest.mock import ANY

import numpy as np
import pytest
import shapely
from PIL import Image

from agribot.autonomy.plan.coverage.area import FieldArea
from agribot.cli.main import main
from agribot.core.facts import SeveralFields
from agribot.core.geo import Datum
from agribot.core.messages import GnssFix, GnssHeading
from agribot.description.loader import load_robot
from agribot.description.worlds_sdf import load_world
from agribot.drivers.gnss.gpsd import GpsdFixes
from agribot.drivers.gnss.receiver_decoder import ReceiverDecoder
from agribot.gis.field_file import read_field
from agribot.gis.mbtiles import read_tile
from agribot.gis.prescription import read_prescription
from agribot.lab.train.photographs import find_pairs, read_pair
from agribot.ui.hand.joystick import JoystickState
from agribot.ui.hand.stick_table import read_table
from tests.finding import refused
from tests.gis.test_map_import import maps
from tests.ui.test_teleop import event

__all__ = ["maps"]  # a fixture

INPUTS = Path(os.environ.get("AGRIBOT_DATA", "")) / "bug-inputs"
DATA, ROBOT = INPUTS / "data", INPUTS / "robot"
pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason="AGRIBOT_DATA holds no bug-inputs")

WHOLE_M2, POND_M2 = 2417.0, 101.0  # of the field of these files, and of what stands in it
CROP = 1
BUTTON, AXIS = 0x01, 0x02
HERE = Datum(lat_deg=48.2, lon_deg=11.6)


class Field(NamedTuple):
    """What a file of one field is to give."""

    ponds: int = 0
    rows: int = 0
    left_out: str = ""


FIELDS = {
    "gpx-overlap.gpx": Field(left_out="20 m behind its end left out"),
    "gpx-two-segments.gpx": Field(left_out="closed over 4.0 m"),
    "iso-hole-in-own-polygon.zip": Field(ponds=1),
    "iso-obstacle-inner-ring-only.zip": Field(ponds=1),
    "iso-road.zip": Field(ponds=1),
    "iso-windbreak.zip": Field(ponds=1),
    "kml-empty-point.kml": Field(left_out="Point 'none' without coordinates"),
    "kml-linear-ring.kml": Field(),
    "kml-path-around-field.kml": Field(),
    "kml-space-after-comma.kml": Field(),
    "kml-unbound-gx.kml": Field(),
    "null-geometry.geojson": Field(left_out="a feature without a place"),
    "qgis-multiline-rows.geojson": Field(rows=2),
    "qgis-multipolygon.geojson": Field(ponds=1),
}


def _measure_m2(area: FieldArea) -> float:
    return float(shapely.Polygon(area.boundary, area.holes).area)


@pytest.mark.parametrize("name", FIELDS)
def test_a_field_is_whole_with_all_that_stands_in_it(name: str) -> None:
    right = FIELDS[name]
    area, _ = read_field(DATA / name)
    assert _measure_m2(area) == pytest.approx(WHOLE_M2 - right.ponds * POND_M2, rel=5e-3)
    assert (len(area.holes), len(area.rows)) == (right.ponds, right.rows)
    assert right.left_out in area.left_out
    assert bool(area.left_out) == bool(right.left_out)


def test_a_plan_is_made_along_a_guidance_line_of_one_point_and_a_heading() -> None:
    area, _ = read_field(ROBOT / "a_plus_line.isoxml.zip")
    east_m, north_m = np.subtract(area.ab_line[1], area.ab_line[0])
    assert abs(east_m) < 0.01 * north_m


@pytest.mark.parametrize(
    ("name", "choices"),
    [("iso-two-ab.zip", ("AB1", "AB2")), ("iso-two-fields.zip", ("North", "South"))],
)
def test_one_of_several_is_chosen_by_its_name(name: str, choices: tuple[str, str]) -> None:
    with refused(SeveralFields(name, 2, ANY, f"'{choices[0]}', '{choices[1]}'", ANY)):
        read_field(DATA / name)
    first, second = (read_field(Path(f"{DATA / name}#{choice}"))[0] for choice in choices)
    assert first != second


@pytest.mark.parametrize(
    ("name", "rates"),
    [("rx-task-in-own-file.zip", {100.0, 200.0}), ("rx-hole-on-edge.geojson", {200.0})],
)
def test_the_zones_of_a_prescription_are_where_they_were_drawn(
    name: str, rates: set[float]
) -> None:
    zones = read_prescription(name, (DATA / name).read_bytes(), HERE)
    found = zones.rates_lpha[np.isfinite(zones.rates_lpha)]
    assert {float(rate) for rate in found if rate} == rates


def _import(folder: Path, labels: Path, name: str, words: tuple[str, ...]) -> np.ndarray:
    """Import labels of a green picture of 240 by 160; the mask that they became."""
    green = Image.new("RGB", (240, 160), (120, 90, 60))
    green.paste((60, 150, 50), (8, 8, 64, 64))
    (folder / "images").mkdir()
    green.save(folder / "images" / "a.png")
    target = folder / name
    target.parent.mkdir(exist_ok=True)
    shutil.copy(labels, target)
    source = target.parent if name.endswith(".txt") else target
    out = folder / "set"
    assert main(["dataset", "import", str(source), *words, "--out", str(out)]) == 0
    (pair,), _ = find_pairs(out, "folder")
    mask: np.ndarray = read_pair(pair)[1]
    return mask


@pytest.mark.parametrize(
    ("source", "name", "classes"),
    [
        ("labelme-bom.json", "a.json", "crop=crop"),
        ("labelme-two-point-polygon.json", "a.json", "crop=crop"),
        ("label-studio-relation-rating.json", "labels.json", "crop=crop"),
        ("yolo-bom.txt", "labels/a.txt", "crop=0"),
        ("yolo-confidence.txt", "labels/a.txt", "crop=0"),
    ],
)
def test_a_label_is_where_its_tool_drew_it(
    source: str, name: str, classes: str, tmp_path: Path
) -> None:
    mask = _import(tmp_path, DATA / source, name, ("--classes", classes))
    assert (mask == CROP).sum() > 40
    assert (mask[70:] != CROP).all()


def test_masks_of_another_picture_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    draws = [sys.executable, str(DATA / "swapped-labels.py")]
    subprocess.run(draws, cwd=tmp_path, check=True)
    out = tmp_path / "photos"
    assert main(["dataset", "import", str(tmp_path / "swapped"), "--out", str(out)]) == 2
    assert "the labels of 10 of 10 pictures do not lie on their plants" in capsys.readouterr().err
    assert not out.exists()


Sample = TypeVar("Sample")


def _read_receiver(name: str, kind: type[Sample]) -> list[Sample]:
    """Read what a log of a receiver gives of one kind."""
    decoder = ReceiverDecoder(lambda text: None)
    found = [*decoder.feed((ROBOT / name).read_bytes(), 0.0), *decoder.feed(b"", 30.0)]
    return [sample for _, sample in found if isinstance(sample, kind)]


def test_a_speed_without_a_course_is_no_velocity() -> None:
    fixes = _read_receiver("rmc_speed_without_course.nmea", GnssFix)
    assert len(fixes) > 3
    assert {fix.velocity_mps for fix in fixes} == {None}


def test_no_altitude_is_not_an_altitude_of_0_m() -> None:
    fixes = _read_receiver("gga_without_altitude.nmea", GnssFix)
    assert len(fixes) > 3
    assert all(math.isnan(fix.alt_m) for fix in fixes)


def test_an_altitude_over_the_sea_and_the_geoid_give_that_over_the_ellipsoid() -> None:
    lines = (ROBOT / "gpsd_without_altHAE.jsonl").read_text().splitlines()
    reports = [report for report in map(json.loads, lines) if report["class"] == "TPV"]
    found = GpsdFixes(pytest.fail).add(reports[0])
    assert found is not None
    assert found.fix.alt_m == pytest.approx(145.2)


def test_the_heading_of_a_second_antenna_is_read_from_its_sentence() -> None:
    headings = _read_receiver("heading_as_ths.nmea", GnssHeading)
    yaws_rad = np.array([heading.yaw_map_rad for heading in headings])
    compass_deg = np.degrees(np.pi / 2.0 - yaws_rad) % 360.0
    assert len(headings) > 3
    assert compass_deg == pytest.approx(143.2, abs=0.05)


def test_a_sensor_is_where_its_own_pose_puts_it() -> None:
    camera = load_robot(str(ROBOT / "cam_pose.urdf"))
    assert camera.body_from_camera()[:3, 3] == pytest.approx((0.4, 0.0, 0.62))
    antenna = load_robot(str(ROBOT / "gps_pose.urdf"))
    assert antenna.gnss is not None
    place_m = antenna.body_from_link(antenna.gnss.link)[:3, 3]
    assert place_m == pytest.approx((-0.2, 0.0, 1.02))


@pytest.mark.parametrize(
    ("name", "place_m"),
    [("link_relative_to_link.world", (2.0, 3.0)), ("link_relative_to_frame.world", (5.0, 3.0))],
)
def test_a_link_stands_where_its_frame_puts_it(name: str, place_m: tuple[float, float]) -> None:
    (obstacle,) = load_world(str(ROBOT / name)).obstacles
    assert obstacle.shapes[-1].origin.xyz_m[:2] == pytest.approx(place_m, abs=1e-3)


def test_every_solid_shape_of_a_world_is_an_obstacle() -> None:
    world = load_world(str(ROBOT / "capsule_ellipsoid_polyline_cone.world"))
    assert len(world.obstacles) == 4


def test_a_quaternion_is_a_turn() -> None:
    (obstacle,) = load_world(str(ROBOT / "pose_quat_xyzw.world")).obstacles
    assert obstacle.yaw_rad == pytest.approx(math.pi / 2)


def test_a_recording_goes_on_behind_a_damaged_chunk(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source, out = ROBOT / "one_bad_chunk_with_index.mcap", tmp_path / "fix.csv"
    assert main(["bag", "csv", str(source), "/fix", "-o", str(out)]) == 1
    assert len(out.read_text().splitlines()) == 1 + 574


def test_a_table_of_ros_2_drives() -> None:
    hand, stick = read_table(DATA / "joy_teleop-ros2.yaml", 1.0, 0.05), JoystickState()
    stick.feed(event(-32767, AXIS, 1) + event(1, BUTTON, 5))
    assert hand.wish(stick).twist == pytest.approx((0.7, 0.0))


def test_tiles_whose_rows_count_from_the_north_are_at_their_place(maps: Path) -> None:
    assert main(["map", "import", str(DATA / "xyz-scheme.mbtiles")]) == 0
    with closing(sqlite3.connect(DATA / "xyz-scheme.mbtiles")) as tiles:
        z, x, y, data = tiles.execute("SELECT * FROM tiles").fetchone()
    assert read_tile(maps / "xyz-scheme.mbtiles", z, x, y) == data
