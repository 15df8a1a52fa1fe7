"""Generated fields: rows as planned, plants by chance, and files that read back the same."""

from __future__ import annotations

import json
import math
import subprocess
from collections import Counter
from pathlib import Path

import msgspec
import numpy as np
import pytest

from agribot.autonomy.estimate.sensors.mapped_rows import MappedRows
from agribot.cli.main import main
from agribot.core import config
from agribot.core.errors import DescriptionError
from agribot.core.geo import MapFrame
from agribot.core.messages import FloatArray, PlantClass
from agribot.core.robot import Shape
from agribot.core.world import Obstacle, Plant, Soil, SoilStrength, WorldSpec
from agribot.description.field_generator import PACKAGED, compute_row_offsets_m, generate_field
from agribot.description.field_settings import (
    CropSettings,
    FieldSettings,
    RowsSettings,
    SoilSettings,
    WeedsSettings,
    read_field_settings,
)
from agribot.description.package import ROOT
from agribot.description.sdf_export import write_world
from agribot.description.worlds_sdf import check_world, list_worlds, load_world
from tests import machine, nightly

NO_WEEDS = WeedsSettings(density_per_m2=0.0)


def _of(world: WorldSpec, kind: PlantClass) -> list[Plant]:
    return [plant for plant in world.plants if plant.plant == kind]


def _xy(plants: list[Plant]) -> FloatArray:
    return np.array([(p.x_map_m, p.y_map_m) for p in plants]).reshape(-1, 2)


def _crops(plan: FieldSettings, seed: int = 0) -> FloatArray:
    return _xy(_of(generate_field(plan, seed), PlantClass.CROP))


def test_rows_stand_where_the_plan_says() -> None:
    rows = RowsSettings(count=3, length_m=4.0, pitch_m=1.5, first_row_start_map_m=(2.0, 1.0))
    xy = _crops(FieldSettings(rows=rows, crop=CropSettings(spacing_m=0.5), weeds=NO_WEEDS))
    expected = {(2.0 + 1.5 * row, 1.0 + 0.5 * k) for row in range(3) for k in range(9)}
    assert {(round(x, 6), round(y, 6)) for x, y in xy.tolist()} == expected


def test_rows_may_look_anywhere() -> None:
    """Turned by a heading, the field is the same about its first plant."""
    north, turned = (
        _crops(FieldSettings(rows=RowsSettings(yaw_deg=yaw), weeds=NO_WEEDS))
        for yaw in (90.0, 20.0)
    )
    turn = np.exp(1j * math.radians(20.0 - 90.0))
    about = (north - north[0]) @ np.array([1.0, 1j]) * turn
    np.testing.assert_allclose((turned - north[0]) @ np.array([1.0, 1j]), about, atol=2e-6)


def test_bent_rows_keep_their_distance_and_spacing() -> None:
    rows = RowsSettings(count=3, length_m=20.0, pitch_m=1.0, curvature_radpm=0.05, yaw_deg=0.0)
    xy = _crops(FieldSettings(rows=rows, crop=CropSettings(spacing_m=0.5), weeds=NO_WEEDS))
    centre = np.array([1.0, 2.0 + 20.0])  # 20 m to the left of the first row
    radius_m = np.hypot(*(xy - centre).T)
    np.testing.assert_allclose(np.unique(radius_m.round(4)), [20.0, 21.0, 22.0])
    for radius in (20.0, 21.0, 22.0):
        gaps_m = np.hypot(*np.diff(xy[np.abs(radius_m - radius) < 0.01], axis=0).T)
        np.testing.assert_allclose(gaps_m, 0.5, atol=1e-3)


def test_rows_bent_beyond_their_centre_are_refused() -> None:
    rows = RowsSettings(count=12, curvature_radpm=-0.1)
    with pytest.raises(DescriptionError, match=r"row 10 .* bent too tightly"):
        generate_field(FieldSettings(rows=rows), 0)


def test_tramlines_leave_room_after_every_few_rows() -> None:
    rows = RowsSettings(count=6, pitch_m=1.0, tramline_every=2, tramline_m=0.5)
    assert compute_row_offsets_m(rows) == [0.0, 1.0, 2.5, 3.5, 5.0, 6.0]


def test_missing_plants_and_gaps_thin_the_rows_as_much_as_asked() -> None:
    rows, crop = RowsSettings(count=40, length_m=25.0), CropSettings(missing_ratio=0.2)
    full = 40 * 101
    missing = full - len(_crops(FieldSettings(rows=rows, crop=crop, weeds=NO_WEEDS)))
    assert abs(missing - 0.2 * full) < 4 * math.sqrt(full * 0.2 * 0.8)
    gaps = CropSettings(gaps_per_row=1.0, gap_length_m=2.0)
    xy = _crops(FieldSettings(rows=rows, crop=gaps, weeds=NO_WEEDS), 3)
    jumps_m = np.concatenate([np.diff(xy[xy[:, 0] == x, 1]) for x in np.unique(xy[:, 0])])
    wide = jumps_m[jumps_m > 0.3]
    assert 15 < len(wide) < 65 and wide.min() >= 2.0


def test_jitter_stays_within_its_bound() -> None:
    still, moved = (
        _crops(FieldSettings(crop=CropSettings(jitter_m=jitter), weeds=NO_WEEDS))
        for jitter in (0.0, 0.05)
    )
    shift_m = np.abs(moved - still)
    assert 0.04 < shift_m.max() <= 0.05 + 1e-6


def test_growth_height_sets_the_size_of_the_crops() -> None:
    crop = CropSettings(height_m=0.4, height_spread_ratio=0.25, species="maize")
    crops = _of(generate_field(FieldSettings(crop=crop), 0), PlantClass.CROP)
    sizes = [plant.size_m for plant in crops]
    assert {plant.species for plant in crops} == {"maize"}
    assert 0.3 <= min(sizes) < 0.32 and 0.48 < max(sizes) <= 0.5


@pytest.mark.parametrize("cluster_ratio", [0.0, 0.6])
def test_weeds_are_as_many_as_asked_and_off_the_crops(cluster_ratio: float) -> None:
    plan = FieldSettings(
        rows=RowsSettings(count=4, pitch_m=3.0, length_m=15.0),
        weeds=WeedsSettings(density_per_m2=2.0, cluster_ratio=cluster_ratio, crop_distance_m=0.05),
    )
    counts = []
    for seed in range(12):
        world = generate_field(plan, seed)
        weeds, crops = (_xy(_of(world, kind)) for kind in (PlantClass.WEED, PlantClass.CROP))
        gaps_m = np.hypot(*(weeds[:, None] - crops[None]).transpose(2, 0, 1))
        assert gaps_m.min() >= 0.05 - 1e-6
        counts.append(len(weeds))
    assert np.mean(counts) == pytest.approx(2.0 * 10.0 * 16.0, rel=0.1)


def test_clusters_bring_weeds_closer_together() -> None:
    def nearest_m(ratio: float) -> float:
        weeds = WeedsSettings(density_per_m2=1.0, cluster_ratio=ratio)
        xy = _xy(_of(generate_field(FieldSettings(weeds=weeds), 5), PlantClass.WEED))
        gaps_m = np.hypot(*(xy[:, None] - xy[None]).transpose(2, 0, 1))
        return float(np.median(np.partition(gaps_m, 1, axis=1)[:, 1]))

    assert nearest_m(1.0) < 0.6 * nearest_m(0.0)


def test_same_seed_grows_the_same_field_and_another_another() -> None:
    plan = read_field_settings(ROOT / "fields" / "beet.toml")
    assert generate_field(plan, 4).plants == generate_field(plan, 4).plants
    assert generate_field(plan, 4).plants != generate_field(plan, 5).plants


def test_a_boundary_keeps_plants_inside_the_polygon(tmp_path: Path) -> None:
    plan = FieldSettings(boundary="field.geojson", rows=RowsSettings(count=10, length_m=12.0))
    frame = MapFrame(plan.datum)
    corners = [(0.5, 1.5), (8.57, 1.5), (0.5, 13.61)]  # a triangle
    ring = [list(frame.geodetic_from_map(x, y)[1::-1]) for x, y in (*corners, corners[0])]
    feature = {"type": "Feature", "geometry": {"type": "Polygon", "coordinates": [ring]}}
    (tmp_path / "field.geojson").write_text(
        json.dumps({"type": "FeatureCollection", "features": [feature]})
    )
    world = generate_field(plan, 0, tmp_path)
    for kind in (PlantClass.CROP, PlantClass.WEED):
        x, y = _xy(_of(world, kind)).T
        assert len(x) > 20
        assert ((x - 0.5) / 8.07 + (y - 1.5) / 12.11 <= 1.0 + 1e-6).all() and x.min() >= 0.5 - 1e-6
    crops = _xy(_of(world, PlantClass.CROP))
    full = _crops(msgspec.structs.replace(plan, boundary=""))
    inside = (full[:, 0] - 0.5) / 8.07 + (full[:, 1] - 1.5) / 12.11 < 1.0 - 1e-4
    assert len(crops) == inside.sum()


def test_plants_stand_on_the_rows_that_a_field_file_draws_however_they_lie(tmp_path: Path) -> None:
    plan = FieldSettings(rows=RowsSettings(file="rows.geojson"), weeds=NO_WEEDS)
    frame = MapFrame(plan.datum)
    lines = [[(0.0, 0.0), (6.0, 1.0)], [(0.0, 1.0), (3.0, 2.0), (7.0, 2.5)]]
    features = [
        {"type": "Feature", "properties": {"kind": kind}, "geometry": {
            "type": "LineString",
            "coordinates": [list(frame.geodetic_from_map(*at)[1::-1]) for at in line],
        }}
        for kind, line in (("row", lines[0]), ("ab_line", [(0, 9), (9, 9)]), ("row", lines[1]))
    ]  # fmt: skip
    tree = {"type": "FeatureCollection", "features": features}
    (tmp_path / "rows.geojson").write_text(json.dumps(tree))
    xy = _xy(_of(generate_field(plan, 0, tmp_path), PlantClass.CROP))
    rows = MappedRows(lines)
    places = [rows.at(x_m, y_m) for x_m, y_m in xy.tolist()]
    for row, length_m in enumerate((math.hypot(6, 1), math.hypot(3, 1) + math.hypot(4, 0.5))):
        along_m = sorted(at.along_m for at in places if at.row == row)
        assert along_m == pytest.approx(np.arange(0.0, length_m, plan.crop.spacing_m), abs=1e-3)
    assert max(abs(at.off_m) for at in places) < 1e-3


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[rows]\ncuont = 3\n", "cuont"),
        ("[crop]\nspacing_m = -1\n", "spacing_m"),
        ("[weeds]\nheight_min_m = 0.3\n", "height_min_m"),
        ("[rows\n", "not valid TOML"),
        ('boundary = "nowhere.geojson"\n', "nowhere.geojson"),
        ('[rows]\nfile = "nowhere.geojson"\n', "nowhere.geojson"),
        ('[rows]\nfile = "x.geojson"\n[soil]\ntrack_gauge_m = 0.6\n', "soil.track_gauge_m"),
        ("[crop]\nmissing_ratio = 1.0\n", "no crop left"),
        ("[crop]\nspecies = 'oats'\n", "field.toml: unknown plant species 'oats'"),
        ("[weeds]\nspecies = ['grass', 'rye']\n", "field.toml: unknown plant species 'rye'"),
    ],
)
def test_a_wrong_plan_is_refused_with_its_reason(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, words: str
) -> None:
    plan = tmp_path / "field.toml"
    plan.write_text(text)
    assert main(["world", "generate", str(plan), "-o", str(tmp_path / "x.world")]) == 2
    assert words in capsys.readouterr().err


def test_the_command_writes_a_world_that_reads_back_to_the_same_plants(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan, out = ROOT / "fields" / "beet.toml", tmp_path / "x.world"
    command = ["world", "generate", str(plan), "--seed", "9", "-o", str(out), "--json"]
    assert main(command) == 0
    world = generate_field(read_field_settings(plan), 9)
    assert load_world(str(out)).plants == world.plants
    assert json.loads(capsys.readouterr().out)["crop"] == len(_of(world, PlantClass.CROP))
    assert check_world(str(out)) == ()


def test_a_plant_that_nobody_can_draw_is_found_before_the_world_is_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan = FieldSettings(crop=CropSettings(species="oats"))
    out = tmp_path / "x.world"
    write_world(generate_field(plan, 0), out)
    assert main(["world", "check", str(out)]) == 0
    assert "warning: unknown plant species 'oats'" in capsys.readouterr().err
    assert main(["world", "check", str(out), "--strict"]) == 1
    assert "x.world: unknown plant species 'oats'; use one of: " in capsys.readouterr().out


def _pose(obstacle: Obstacle, shape: Shape) -> FloatArray:
    from agribot.core.geo import transform

    at = (obstacle.x_map_m, obstacle.y_map_m, obstacle.z_map_m)
    return transform(at, (0.0, 0.0, obstacle.yaw_rad)) @ shape.origin.matrix()


@pytest.mark.parametrize("name", list_worlds())
def test_a_world_is_the_same_after_writing_and_reading(name: str, tmp_path: Path) -> None:
    first = load_world(name, seed=3)
    file = tmp_path / "again.world"
    write_world(first, file)
    again = load_world(str(file), seed=8)
    assert again.plants == first.plants and again.warnings == ()
    for field in ("name", "datum", "gravity_mps2", "friction_ratio", "spawn_xy_map_m"):
        assert getattr(again, field) == getattr(first, field), field
    assert again.spawn_yaw_map_rad == pytest.approx(first.spawn_yaw_map_rad)
    np.testing.assert_allclose(again.field_enu_t, first.field_enu_t)
    np.testing.assert_allclose(again.light.to_sun, first.light.to_sun, atol=1e-9)
    assert (again.light.diffuse, again.light.ambient) == (
        first.light.diffuse, first.light.ambient,
    )  # fmt: skip
    assert again.ground == first.ground
    assert [(o.name, o.kind, o.collides) for o in again.obstacles] == [
        (o.name, o.kind, o.collides) for o in first.obstacles
    ]
    for there, here in zip(again.obstacles, first.obstacles, strict=True):
        for shape, other in zip(there.shapes, here.shapes, strict=True):
            assert (shape.kind, shape.size_m) == (other.kind, other.size_m)
            assert shape.rgba[:3] == other.rgba[:3]
            np.testing.assert_allclose(_pose(there, shape), _pose(here, other), atol=1e-9)
    if first.terrain is not None:
        assert again.terrain is not None
        assert np.array_equal(again.terrain.height_m, first.terrain.height_m)
        assert (again.terrain.x_min_m, again.terrain.y_min_m, again.terrain.resolution_m) == (
            first.terrain.x_min_m, first.terrain.y_min_m, first.terrain.resolution_m,
        )  # fmt: skip


@nightly.one_by_one("name", ["hills", "Farm"], in_suite=1)
def test_a_written_world_passes_the_sdf_checker(name: str, tmp_path: Path) -> None:
    machine.require("ign")
    write_world(load_world(name), tmp_path / "again.world")
    done = subprocess.run(
        ["ign", "sdf", "-k", str(tmp_path / "again.world")],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert "Valid." in done.stdout, done.stdout + done.stderr


@pytest.mark.parametrize(("name", "seed"), sorted(PACKAGED.items()))
def test_the_packaged_generated_worlds_are_current(tmp_path: Path, name: str, seed: int) -> None:
    plan = read_field_settings(ROOT / "fields" / f"{name}.toml")
    write_world(generate_field(plan, seed), tmp_path / f"{name}.world")
    kept = (ROOT / "worlds" / f"{name}.world").read_text("utf-8")
    assert (tmp_path / f"{name}.world").read_text("utf-8") == kept, (
        "run python -m agribot.description.field_generator"
    )


@pytest.mark.parametrize("name", sorted(PACKAGED))
def test_a_profile_drives_the_rows_of_its_generated_world(name: str) -> None:
    settings, plan = config.load(name), read_field_settings(ROOT / "fields" / f"{name}.toml")
    field, rows = settings.field, plan.rows
    assert settings.world == name and field.datum == plan.datum == load_world(name).datum
    assert field.first_row_start_map_m == rows.first_row_start_map_m
    assert (field.row_yaw_deg, field.row_length_m) == (rows.yaw_deg, rows.length_m)
    assert (field.row_pitch_m, field.row_count) == (rows.pitch_m, rows.count)


def test_the_benchmark_has_ten_rows_of_49_plants_and_a_start_known_to_5_cm_and_2_degrees() -> None:
    world, field = load_world("rows-10x12"), config.load("rows-10x12").field
    rows = Counter(
        round(-plant.y_map_m) for plant in world.plants if plant.plant == PlantClass.CROP
    )
    assert rows == {row: 49 for row in range(10)}
    assert field.start_map_m is not None and field.start_yaw_deg is not None
    off_m = math.dist(world.spawn_xy_map_m, field.start_map_m)
    off_deg = abs(math.degrees(world.spawn_yaw_map_rad) - field.start_yaw_deg)
    assert 0.0 < off_m < 2 * field.start_std_m
    assert 0.0 < off_deg < 2 * field.start_yaw_std_deg


def test_litter_and_tracks_of_a_plan_survive_the_file(tmp_path: Path) -> None:
    soil = SoilSettings(residue_ratio=0.5, stones_ratio=0.25, wet_ratio=0.125, track_gauge_m=0.78)
    plan = FieldSettings(weeds=NO_WEEDS, soil=soil, rows=RowsSettings(count=3, length_m=4.0))
    field = generate_field(plan, 0)
    write_world(field, tmp_path / "x.world")
    again = load_world(str(tmp_path / "x.world"))
    assert again.soil == field.soil == Soil(residue_ratio=0.5, stones_ratio=0.25, wet_ratio=0.125)
    tracks = [tile for tile in again.ground if tile.surface == "track"]
    middles = sorted((tile.x_min_m + tile.x_max_m) / 2.0 for tile in tracks)
    # The rows go North from x = 1, 2 and 3 m.
    expected = sorted(row + side for row in (1.0, 2.0, 3.0) for side in (-0.39, 0.39))
    assert middles == pytest.approx(expected, abs=1e-6)
    assert {round(tile.y_max_m - tile.y_min_m, 6) for tile in tracks} == {6.0}


def test_how_a_plans_soil_carries_survives_the_file(tmp_path: Path) -> None:
    file = tmp_path / "plan.toml"
    file.write_text('[soil]\nsoil_class = "tilled"\nmoisture_ratio = 0.3\n[rows]\nlength_m = 3.0\n')
    field = generate_field(read_field_settings(file), 0)
    write_world(field, tmp_path / "x.world")
    again = load_world(str(tmp_path / "x.world"))
    told = SoilStrength(soil_class="tilled", moisture_ratio=0.3)
    assert again.strength == field.strength == told
    assert load_world("beet").strength == SoilStrength()


@pytest.mark.parametrize(
    ("attribute", "refusal"),
    [
        ('soil_class="mud"', "soil_class: 'mud' is unknown; use rigid, firm, tilled, soft"),
        ('moisture_ratio="2"', "moisture_ratio 2: out of range; give 0 to 1"),
        ('depth_m="0.1"', "depth_m: unknown; use soil_class, moisture_ratio"),
    ],
)
def test_impossible_soil_of_a_world_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], attribute: str, refusal: str
) -> None:
    text = (ROOT / "worlds" / "empty.world").read_text("utf-8")
    file = tmp_path / "x.world"
    tag = f"<agribot:strength {attribute}/><gravity>"
    file.write_text(text.replace("<gravity>", tag), "utf-8")
    assert main(["world", "check", str(file)]) == 2
    said = capsys.readouterr().err.strip()
    assert refusal in said and len(said.splitlines()) == 1


def test_impossible_soil_of_a_plan_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "plan.toml"
    for line, word in (('soil_class = "mud"', "mud"), ("moisture_ratio = 1.5", "<= 1")):
        file.write_text(f"[soil]\n{line}\n")
        assert main(["world", "generate", str(file), "-o", str(tmp_path / "x.world")]) == 2
        said = capsys.readouterr().err.strip()
        assert word in said and len(said.splitlines()) == 1


def test_tracks_beside_bent_rows_are_refused() -> None:
    bent = FieldSettings(
        rows=RowsSettings(curvature_radpm=0.01), soil=SoilSettings(track_gauge_m=0.78)
    )
    with pytest.raises(DescriptionError, match="straight rows"):
        generate_field(bent, 0)


def test_a_soil_ratio_over_one_is_refused_with_its_name(tmp_path: Path) -> None:
    text = (ROOT / "worlds" / "empty.world").read_text("utf-8")
    file = tmp_path / "x.world"
    file.write_text(text.replace("<gravity>", '<agribot:soil wet_ratio="1.5"/><gravity>'), "utf-8")
    with pytest.raises(DescriptionError, match=r"wet_ratio 1\.5: out of range; give 0 to 1"):
        load_world(str(file))
