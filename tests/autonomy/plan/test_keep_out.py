"""Areas that a map shows as occupied: driven around, refused, cut out of fields, and fenced."""

from __future__ import annotations

import json
from pathlib import Path
from unittest.mock import ANY

import msgspec
import numpy as np
import pytest
import shapely
from PIL import Image

from agribot.app.keep_out import read_keep_out, settle_keep_out
from agribot.app.tasks import choose_task
from agribot.autonomy.control.keep_out_fence import KeepOutFence
from agribot.autonomy.control.supervise import Supervisor
from agribot.autonomy.plan.coverage.area import FieldArea
from agribot.autonomy.plan.ways.boustrophedon import plan_rows
from agribot.autonomy.plan.ways.keep_out import KeepOut
from agribot.autonomy.plan.ways.obstacles import Obstacles, make_obstacles
from agribot.autonomy.plan.ways.rows import lay_rows
from agribot.cli.main import main
from agribot.core import config
from agribot.core.config import RunConfig, SafetyConfig
from agribot.core.errors import ConfigError, DescriptionError
from agribot.core.facts import EntersKeepOut, InKeepOut, KeptOutEverywhere, NearKeptOut
from agribot.core.geo import Datum, MapFrame
from agribot.core.keep_out import BodyBox
from agribot.core.messages import STOP, DriveCommand, GnssQuality
from agribot.core.messages import Path as Way
from agribot.description.loader import load_robot
from agribot.description.ros_map import (
    FREE,
    OCCUPIED,
    UNKNOWN,
    RosMap,
    load_ros_map,
    save_ros_map,
)
from agribot.gis.field_file import read_field
from agribot.gis.keep_out_ground import cut_keep_out
from agribot.gis.map_outlines import outline_cells
from tests.autonomy.control.test_fence import along
from tests.autonomy.control.test_supervisor import ROBOT, Gate, assert_stopped, goal
from tests.autonomy.plan.planting import FARM, FARM_START, MISSION, at
from tests.finding import refused
from tests.robot_parts import plain_rover

CLEARANCE_M = 0.3
ROWS = lay_rows(FARM)
BLOCK = ((-0.9, 0.2), (-0.4, 0.2), (-0.4, 0.8), (-0.9, 0.8))
CELL_M = 0.1


def around(*rings: tuple[tuple[float, float], ...]) -> Obstacles:
    return make_obstacles((), CLEARANCE_M, load_robot(), rings)


def smallest_gap_m(path: Way, ring: tuple[tuple[float, float], ...], body: Obstacles) -> float:
    """By bodies that are drawn one by one: no formula of the planner."""
    shape, area = body.body, shapely.Polygon(ring)
    gaps = []
    for (x_m, y_m), yaw_rad in zip(path.xy_map_m[::3], path.yaw_map_rad[::3], strict=True):
        box = shapely.box(-shape.rear_m, -shape.half_width_m, shape.front_m, shape.half_width_m)
        turned = shapely.affinity.rotate(box, yaw_rad, origin=(0, 0), use_radians=True)
        gaps.append(shapely.affinity.translate(turned, x_m, y_m).distance(area))
    return min(gaps)


def draw_map(
    *boxes: tuple[float, float, float, float], state: int = OCCUPIED, yaw_rad: float = 0.0
) -> RosMap:
    """A map of 16 m about (5, 5), free but for boxes: west, south, east, north."""
    cells = np.full((160, 160), FREE, np.int8)
    for box in boxes:
        west, south, east, north = (round((value + 3.0) / CELL_M) for value in box)
        cells[south:north, west:east] = state
    return RosMap(cells=cells, resolution_m=CELL_M, x_min_m=-3.0, y_min_m=-3.0, yaw_rad=yaw_rad)


def test_the_first_row_is_reached_around_an_area_in_the_way() -> None:
    free = plan_rows(ROWS, FARM_START, plain_rover(), MISSION)
    body = around(BLOCK)
    assert smallest_gap_m(free, BLOCK, body) < CLEARANCE_M
    path = plan_rows(ROWS, FARM_START, plain_rover(), MISSION, (), body)
    assert smallest_gap_m(path, BLOCK, body) >= CLEARANCE_M - 0.01
    assert set(path.row.tolist()) == {-1, *range(6)}


def test_an_area_on_a_row_and_one_before_a_waypoint_refuse_the_mission_with_their_places() -> None:
    x_m, y_m, yaw_rad = FARM_START
    start = msgspec.structs.replace(at(x_m, y_m, 0.0), yaw_map_rad=yaw_rad)
    on_row = json.dumps([[[2.9, 5.0], [3.2, 5.0], [3.2, 5.4], [2.9, 5.4]]])
    farm = config.load("farm", [f"field.keep_out_map_m={on_row}"])
    with refused(NearKeptOut(ANY, ANY, ANY, 3.05, 5.2, ANY)):
        choose_task(farm, load_robot()).plan(start)
    field = msgspec.structs.replace(FARM, keep_out_map_m=(((2.0, -0.2), (2.2, 0.2), (2.0, 0.2)),))
    settings = RunConfig(field=field, mission=MISSION)
    with refused(NearKeptOut(ANY, ANY, 0.0, ANY, ANY, ANY)):
        choose_task(settings, load_robot(), ((4.0, 0.0),)).plan(at(0.0, 0.0, 0.0))


@pytest.mark.parametrize("yaw_rad", [0.0, 0.7, -2.0])
def test_outlines_hold_the_occupied_cells_wherever_the_map_is_turned(yaw_rad: float) -> None:
    drawn = draw_map((1.0, 2.0, 1.5, 2.1), (4.0, 4.0, 6.0, 6.0), yaw_rad=yaw_rad)
    areas = shapely.union_all([shapely.Polygon(ring) for ring in outline_cells(drawn, {OCCUPIED})])
    rng = np.random.default_rng(1)
    for x_m, y_m in rng.uniform(-12.0, 18.0, (3000, 2)).tolist():
        point = shapely.Point(x_m, y_m)
        if drawn.read_cell(x_m, y_m) == OCCUPIED:
            assert areas.covers(point)
        elif areas.covers(point):
            near = [drawn.read_cell(x_m + dx, y_m + dy)
                    for dx in (-0.1, 0.0, 0.1) for dy in (-0.1, 0.0, 0.1)]  # fmt: skip
            assert OCCUPIED in near


def test_a_wall_around_a_yard_leaves_the_yard_free() -> None:
    walls = draw_map((0.0, 0.0, 10.0, 10.0))
    walls.cells[35:125, 35:125] = FREE
    keep_out = KeepOut(outline_cells(walls, {OCCUPIED}))
    body = BodyBox(0.4, 0.4, 0.4)
    assert keep_out.find_touch(np.array([[5.0, 5.0, 0.3]]), body, 0.3) is None
    assert keep_out.find_touch(np.array([[0.8, 5.0, 0.3]]), body, 0.3) is not None


def test_unknown_cells_are_free_or_kept_out_of_and_the_datum_moves_the_map(tmp_path: Path) -> None:
    datum = Datum(lat_deg=21.1612, lon_deg=72.787)
    lat_deg, lon_deg, _ = MapFrame(datum).geodetic_from_map(20.0, -5.0)
    moved = msgspec.structs.replace(
        draw_map((1.0, 1.0, 2.0, 2.0), state=UNKNOWN), datum=Datum(lat_deg=lat_deg, lon_deg=lon_deg)
    )
    save_ros_map(moved, tmp_path / "map.yaml")
    assert read_keep_out(tmp_path / "map.yaml", datum) == ()
    (ring,) = read_keep_out(tmp_path / "map.yaml", datum, with_unknown=True)
    assert np.mean(ring, axis=0) == pytest.approx([21.5, -3.5], abs=0.01)
    field = msgspec.structs.replace(
        FARM, keep_out=str(tmp_path / "map.yaml"), keep_out_unknown=True, datum=datum
    )
    settled = settle_keep_out(RunConfig(field=field)).field
    assert (settled.keep_out, settled.keep_out_map_m) == ("", (ring,))


def test_a_map_as_ros_2_saves_it_as_pgm_with_its_origin_as_a_list(tmp_path: Path) -> None:
    shades = np.full((20, 30), 254, np.uint8)
    shades[2:5, 10:14] = 0
    Image.fromarray(shades).save(tmp_path / "yard.pgm")
    (tmp_path / "yard.yaml").write_text(
        "image: yard.pgm\nmode: trinary\nresolution: 0.5\norigin:\n  - -2.0\n  - 1.0\n  - 0.5\n"
        "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.25\n"
    )
    read = load_ros_map(tmp_path / "yard.yaml")
    assert (read.x_min_m, read.y_min_m, read.yaw_rad) == (-2.0, 1.0, 0.5)
    assert (read.cells == OCCUPIED).sum() == 12
    save_ros_map(read, tmp_path / "again.yaml")
    assert load_ros_map(tmp_path / "again.yaml").yaw_rad == 0.5


def test_an_area_of_two_corners_is_refused_with_its_number() -> None:
    field = msgspec.structs.replace(FARM, keep_out_map_m=(BLOCK, ((0.0, 0.0), (1.0, 1.0))))
    with pytest.raises(ConfigError, match="area 2 of 2 has 2 corners; give at least 3"):
        settle_keep_out(RunConfig(field=field))


def test_more_specks_than_can_be_planned_with_are_refused() -> None:
    noise = np.random.default_rng(3).choice([FREE, OCCUPIED], (520, 520), p=[0.7, 0.3])
    speckled = RosMap(cells=noise.astype(np.int8), resolution_m=1.0, x_min_m=0.0, y_min_m=0.0)
    with pytest.raises(
        DescriptionError, match=r"stretches of occupied cells > 50000; remove specks"
    ):
        outline_cells(speckled, {OCCUPIED})


def test_areas_are_cut_out_of_a_field() -> None:
    field = FieldArea(boundary=((0.0, 0.0), (20.0, 0.0), (20.0, 10.0), (0.0, 10.0)))
    inside = ((5.0, 4.0), (6.0, 4.0), (6.0, 5.0), (5.0, 5.0))
    across = ((15.0, -1.0), (16.0, -1.0), (16.0, 11.0), (15.0, 11.0))
    cut = cut_keep_out(field, (inside, across))
    assert shapely.Polygon(cut.boundary).bounds == (0.0, 0.0, 15.0, 10.0)
    assert [shapely.Polygon(hole).area for hole in cut.holes] == [1.0]
    assert "40.0 m2 are cut off" in cut.left_out
    assert cut_keep_out(field, ()) is field
    with refused(KeptOutEverywhere):
        cut_keep_out(field, (((-1.0, -1.0), (21.0, -1.0), (21.0, 11.0), (-1.0, 11.0)),))


def test_a_plan_of_a_field_works_around_the_map(tmp_path: Path) -> None:
    datum = Datum(lat_deg=21.1612, lon_deg=72.787)
    frame = MapFrame(datum)
    corners = [frame.geodetic_from_map(x, y)[1::-1]
               for x, y in ((0, 0), (12, 0), (12, 12), (0, 12), (0, 0))]  # fmt: skip
    (tmp_path / "field.geojson").write_text(json.dumps({
        "type": "FeatureCollection", "features": [{
            "type": "Feature", "properties": {"kind": "boundary"},
            "geometry": {"type": "Polygon", "coordinates": [corners]},
        }]}))  # fmt: skip
    stone = msgspec.structs.replace(draw_map((5.0, 5.0, 6.0, 6.0)), datum=datum)
    save_ros_map(stone, tmp_path / "map.yaml")
    plan = ["plan", "--field", str(tmp_path / "field.geojson"), "--implement-width", "1"]
    plan += ["--keep-out", str(tmp_path / "map.yaml"), "--out", str(tmp_path / "plan.geojson")]
    assert main(plan) == 0
    saved = json.loads((tmp_path / "plan.geojson").read_text())
    east_m, north_m = 5.5, 5.5
    lat_deg, lon_deg, _ = frame.geodetic_from_map(east_m, north_m)
    shapes = [feature["geometry"] for feature in saved["features"]]
    ways = [shapely.LineString(shape["coordinates"])
            for shape in shapes if shape["type"] == "LineString"]  # fmt: skip
    away_deg = min(way.distance(shapely.Point(lon_deg, lat_deg)) for way in ways)
    assert away_deg * 103_800 > 0.8  # metres of a degree of longitude there
    main(["plan", "--field", str(tmp_path / "field.geojson"), "--implement-width", "1",
          "--out", str(tmp_path / "free.geojson")])  # fmt: skip
    assert main(["plan", "verify", str(tmp_path / "free.geojson")]) == 0


def test_the_map_of_a_field_keeps_a_robot_inside_of_it_and_off_its_obstacles(
    tmp_path: Path,
) -> None:
    field = "examples/field.geojson"
    assert main(["world", "map", field, "-o", str(tmp_path / "map.yaml")]) == 0
    drawn, (area, datum) = load_ros_map(tmp_path / "map.yaml"), read_field(Path(field))
    assert drawn.datum is not None
    assert (drawn.datum.lat_deg, drawn.datum.lon_deg) == (datum.lat_deg, datum.lon_deg)
    ground = shapely.Polygon(area.boundary, area.holes)
    keep_out = shapely.union_all(
        [shapely.Polygon(ring) for ring in read_keep_out(tmp_path / "map.yaml", datum)]
    )
    assert area.holes
    assert ground.intersection(keep_out).area < 0.05 * ground.area
    assert ground.exterior.within(keep_out.buffer(0.1))
    assert all(keep_out.buffer(0.1).covers(shapely.Polygon(hole)) for hole in area.holes)
    fine = ["--resolution", "0.001", "-o", str(tmp_path / "x.yaml")]
    assert main(["world", "map", field, *fine]) == 2


def fence(config: SafetyConfig) -> KeepOutFence:
    return KeepOutFence(KeepOut([((5.0, -1.0), (6.0, -1.0), (6.0, 1.0), (5.0, 1.0))]),
                        BodyBox(0.5, 0.4, 0.45), config, CLEARANCE_M, 1.5)  # fmt: skip


def test_the_fence_stops_a_robot_before_the_area_and_lets_it_back_out() -> None:
    standing, ahead = fence(SafetyConfig()), DriveCommand(v_mps=0.4)
    way = msgspec.structs.replace(goal("running"), path=along((0.0, 0.0), (9.0, 0.0)))
    braking_m = 0.4 * 0.2 + 0.4**2 / 3.0
    said = [(x, standing.objection(at(x, 0.0, 0.0), ahead, way)) for x in np.arange(3.0, 5.0, 0.01)]
    first_m = min(x for x, fact in said if fact)
    assert first_m == pytest.approx(5.0 - 0.5 - braking_m, abs=0.02)
    enters = dict(said)[first_m]
    assert isinstance(enters, EntersKeepOut)
    assert enters.area_x_map_m == pytest.approx(5.5)
    assert isinstance(standing.objection(at(4.6, 0.0, 0.0), STOP, way), InKeepOut)
    assert standing.objection(at(3.0, 2.0, 0.0), ahead, way) is None
    assert isinstance(standing.crossing(at(first_m, 0.0, 0.0), ahead), EntersKeepOut)
    assert standing.crossing(at(4.8, 0.0, 0.0), DriveCommand(v_mps=-0.2)) is None


def test_the_supervisor_holds_a_robot_before_the_area_on_every_way() -> None:
    gate, ahead = Gate(), DriveCommand(v_mps=0.2)
    assert gate.send(ahead)[1] is None
    near = KeepOutFence(KeepOut([((0.54, -1.0), (1.0, -1.0), (1.0, 1.0), (0.54, 1.0))]),
                        BodyBox(0.5, 0.4, 0.45), SafetyConfig(), CLEARANCE_M, 1.5)  # fmt: skip
    fenced = Gate()
    fenced.supervisor = Supervisor(SafetyConfig(), ROBOT, keep_out=near)
    sent, reason = fenced.send(ahead)
    assert_stopped(sent, reason, EntersKeepOut)
    assert fenced.send(DriveCommand(v_mps=-0.1))[1] is None


def test_an_unsure_robot_stops_earlier_by_half_of_what_plans_keep_at_most() -> None:
    standing, ahead = fence(SafetyConfig()), DriveCommand(v_mps=0.4)
    way = msgspec.structs.replace(goal("running"), path=along((0.0, 0.0), (9.0, 0.0)))

    def find_stop_m(std_m: float, quality: GnssQuality) -> float:
        return min(
            x for x in np.arange(3.0, 5.0, 0.01)
            if standing.objection(msgspec.structs.replace(
                at(x, 0.0, 0.0), pos_std_m=std_m, quality=quality), ahead, way)
        )  # fmt: skip

    sure_m = find_stop_m(0.02, GnssQuality.RTK_FIXED)
    assert sure_m - find_stop_m(1.0, GnssQuality.SINGLE) == pytest.approx(0.15, abs=0.02)
