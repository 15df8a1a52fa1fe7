"""Random fields: rows of crops with gaps, and weeds in between, from a plan and a seed.

`python -m agribot.description.field_generator` writes the generated worlds of the package again;
a test holds their text.
"""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np

from agribot.core.errors import DescriptionError
from agribot.core.geo import MapFrame
from agribot.core.geometries import list_geometries
from agribot.core.messages import FloatArray, PlantClass, Row
from agribot.core.table_text import read_text_file
from agribot.core.world import GroundTile, Plant, Relief, RowTable, Soil, SoilStrength, WorldSpec
from agribot.description.drawn_rows import (
    list_pieces,
    measure_line_m,
    place_on_line,
    read_drawn_rows,
)
from agribot.description.field_plants import DIGITS, make_plant, make_weed, place_weeds
from agribot.description.field_settings import (
    CropSettings,
    FieldSettings,
    RowsSettings,
    read_field_settings,
)
from agribot.description.package import ROOT
from agribot.description.sdf_export import write_world

AROUND_M = 15.0  # width of the grass beyond the soil
SOIL_M = 6.0  # width of the soil beyond the outermost crops
PACKAGED = {"beet": 1, "rows-10x12": 1}  # plan -> seed of the worlds that come along


def generate_field(plan: FieldSettings, seed: int, folder: Path = Path()) -> WorldSpec:
    """Generate a world with the field of a plan; the same plan and seed give the same plants.

    `folder` is where the plan's files of boundary and rows lie.
    Raises: DescriptionError: no crop is left, or a file of the plan cannot be read.
    """
    rng = [np.random.default_rng([seed, part]) for part in range(2)]
    drawn = read_drawn_rows(folder / plan.rows.file, plan.datum) if plan.rows.file else []
    rows = [_sow_line(plan.crop, line, rng[0]) for line in drawn]
    rows = rows or [_place_row(plan, index, rng[0]) for index in range(plan.rows.count)]
    crops_xy_m = np.concatenate(rows)
    ring = _read_boundary(plan, folder)
    if ring is not None:
        crops_xy_m = crops_xy_m[_find_inside(crops_xy_m, ring)]
    if len(crops_xy_m) == 0:
        raise DescriptionError(
            f"field '{plan.name}' has no crop left; lower crop.missing_ratio or crop.gaps_per_row, "
            "or move rows.first_row_start_map_m into the boundary"
        )
    weeds_xy_m = place_weeds(plan.weeds, crops_xy_m, rng[1])
    if ring is not None:
        weeds_xy_m = weeds_xy_m[_find_inside(weeds_xy_m, ring)]
    plants = [_make_crop(plan, at, rng[0]) for at in crops_xy_m]
    plants += [make_weed(plan.weeds, at, rng[1]) for at in weeds_xy_m]
    return WorldSpec(
        name=plan.name,
        datum=plan.datum,
        rows=_make_row_table(plan),
        spawn_xy_map_m=plan.spawn_xy_map_m,
        spawn_yaw_map_rad=math.radians(plan.spawn_yaw_deg),
        ground=(*_make_ground(crops_xy_m, plan.spawn_xy_map_m), *_make_tracks(plan)),
        soil=Soil(
            residue_ratio=plan.soil.residue_ratio,
            stones_ratio=plan.soil.stones_ratio,
            wet_ratio=plan.soil.wet_ratio,
        ),
        strength=SoilStrength(
            soil_class=plan.soil.soil_class, moisture_ratio=plan.soil.moisture_ratio
        ),
        relief=_make_relief(plan, seed, list_pieces(drawn)),
        plants=tuple(plants),
    )


def _make_row_table(plan: FieldSettings) -> RowTable | None:
    """Make the table of a plan's rows; none where they lie as no table says."""
    rows = plan.rows
    if rows.file or rows.tramline_every or plan.boundary:
        return None
    return RowTable(
        first_row_start_map_m=rows.first_row_start_map_m,
        row_yaw_deg=rows.yaw_deg,
        row_length_m=rows.length_m,
        row_curvature_radpm=rows.curvature_radpm,
        row_pitch_m=rows.pitch_m,
        row_count=rows.count,
        plant_spacing_m=plan.crop.spacing_m,
    )


def _make_relief(plan: FieldSettings, seed: int, drawn: list[Row]) -> Relief:
    """Make the relief of a plan, its ridges and tracks along the rows; none where none is asked."""
    asked = plan.relief
    if not (
        asked.roughness_rms_m or asked.clods_per_m2 or asked.ridge_height_m or asked.track_depth_m
    ):
        return Relief()
    return Relief(
        seed=seed,
        roughness_rms_m=asked.roughness_rms_m,
        clods_per_m2=asked.clods_per_m2,
        clod_height_m=asked.clod_height_m,
        ridge_height_m=asked.ridge_height_m,
        track_depth_m=asked.track_depth_m,
        track_gauge_m=plan.soil.track_gauge_m,
        track_width_m=plan.soil.track_width_m,
        rows=tuple(drawn) or lay_parallel_rows(plan.rows),
    )


def lay_parallel_rows(rows: RowsSettings) -> tuple[Row, ...]:
    """Lay the rows that settings describe by their number, distance and bend."""
    lines = []
    for index, offset_m in enumerate(compute_row_offsets_m(rows)):
        ends = _bend(rows, np.array([0.0, rows.length_m]), offset_m).round(DIGITS).tolist()
        stretch = 1.0 + rows.curvature_radpm * offset_m
        lines.append(
            Row(
                index=index,
                start_map_m=(ends[0][0], ends[0][1]),
                end_map_m=(ends[1][0], ends[1][1]),
                curvature_radpm=rows.curvature_radpm / stretch,
            )
        )
    return tuple(lines)


def compute_row_offsets_m(rows: RowsSettings) -> list[float]:
    """Return how far each row lies to the right of the first one, with tramlines."""
    every = rows.tramline_every
    return [
        index * rows.pitch_m + (index // every * rows.tramline_m if every else 0.0)
        for index in range(rows.count)
    ]


def _place_row(plan: FieldSettings, index: int, rng: np.random.Generator) -> FloatArray:
    """Place the crops of a row; return their map positions, (n, 2)."""
    rows, crop = plan.rows, plan.crop
    offset_m = compute_row_offsets_m(rows)[index]
    stretch = 1.0 + rows.curvature_radpm * offset_m  # stretch of an outer row against the first one
    if stretch <= 0.1:
        raise DescriptionError(
            f"row {index + 1} of field '{plan.name}' is bent too tightly: with curvature "
            f"{rows.curvature_radpm:g} rad/m rows end {1.0 / abs(rows.curvature_radpm):.1f} m to "
            "the right of the first; lower rows.curvature_radpm"
        )
    count = math.floor(rows.length_m * stretch / crop.spacing_m + 1e-9) + 1
    along_m: FloatArray = np.arange(count, dtype=np.float64) * (crop.spacing_m / stretch)
    return _sow(crop, along_m, _bend(rows, along_m, offset_m), rows.length_m, rng)


def _sow_line(crop: CropSettings, line: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Place the crops of a row that a map draws; return their map positions, (n, 2)."""
    length_m = measure_line_m(line)
    count = math.floor(length_m / crop.spacing_m + 1e-3) + 1  # degrees are rounded in files
    along_m: FloatArray = np.arange(count, dtype=np.float64) * crop.spacing_m
    return _sow(crop, along_m, place_on_line(line, along_m), length_m, rng)


def _sow(
    crop: CropSettings, along_m: FloatArray, places_m: FloatArray, length_m: float,
    rng: np.random.Generator,
) -> FloatArray:  # fmt: skip
    """Leave out the plants of a row that did not come up, and move the others off their places."""
    kept = rng.uniform(size=len(along_m)) >= crop.missing_ratio
    for _ in range(int(rng.poisson(crop.gaps_per_row))):
        start_m = rng.uniform(0.0, max(length_m - crop.gap_length_m, 0.0))
        kept &= (along_m < start_m) | (along_m > start_m + crop.gap_length_m)
    jitter_m = rng.uniform(-crop.jitter_m, crop.jitter_m, (len(along_m), 2))
    sown: FloatArray = (places_m + jitter_m)[kept]
    return sown


def _bend(rows: RowsSettings, along_m: FloatArray, offset_m: float) -> FloatArray:
    """Return map points (n, 2) beside the first row's curve, at `along_m` (n,) on it."""
    yaw, bend = math.radians(rows.yaw_deg), rows.curvature_radpm
    heading = yaw + bend * along_m
    if bend:
        x = (np.sin(heading) - math.sin(yaw)) / bend
        y = (math.cos(yaw) - np.cos(heading)) / bend
    else:
        x, y = along_m * math.cos(yaw), along_m * math.sin(yaw)
    right = np.stack([np.sin(heading), -np.cos(heading)], axis=1)
    places: FloatArray = np.stack([x, y], axis=1) + offset_m * right
    places += np.array(rows.first_row_start_map_m)
    return places


def _make_crop(plan: FieldSettings, at_m: FloatArray, rng: np.random.Generator) -> Plant:
    spread = plan.crop.height_spread_ratio
    height_m = plan.crop.height_m * float(rng.uniform(1.0 - spread, 1.0 + spread))
    return make_plant(
        plan.crop.species, PlantClass.CROP, at_m, height_m, plan.crop.stem_radius_m, rng
    )


def _make_ground(crops_xy_m: FloatArray, spawn: tuple[float, float]) -> tuple[GroundTile, ...]:
    """Make soil under the field and the robot, grass around it."""
    points = np.concatenate([crops_xy_m, [spawn]])
    low, high = np.floor(points.min(axis=0)), np.ceil(points.max(axis=0))

    def make_tile(surface: str, margin_m: float) -> GroundTile:
        (x_min, y_min), (x_max, y_max) = (low - margin_m).tolist(), (high + margin_m).tolist()
        return GroundTile(
            surface=surface, x_min_m=x_min, y_min_m=y_min, x_max_m=x_max, y_max_m=y_max
        )

    return make_tile("grass", SOIL_M + AROUND_M), make_tile("soil", SOIL_M)


def _make_tracks(plan: FieldSettings) -> list[GroundTile]:
    """Make the tracks of wheels, a pair astride each row."""
    rows, soil = plan.rows, plan.soil
    if not soil.track_gauge_m:
        return []
    if rows.curvature_radpm or rows.yaw_deg % 90.0:
        raise DescriptionError(
            f"field '{plan.name}': soil.track_gauge_m needs straight rows along an axis of the "
            f"map; rows.curvature_radpm is {rows.curvature_radpm:g}, rows.yaw_deg {rows.yaw_deg:g}"
        )
    ends_m = np.array([-1.0, rows.length_m + 1.0])
    half_m = soil.track_width_m / 2.0
    tiles = []
    for offset_m in compute_row_offsets_m(rows):
        for side_m in (-soil.track_gauge_m / 2.0, soil.track_gauge_m / 2.0):
            edges = [_bend(rows, ends_m, offset_m + side_m + edge) for edge in (-half_m, half_m)]
            low = np.min(edges, axis=(0, 1)).round(DIGITS).tolist()
            high = np.max(edges, axis=(0, 1)).round(DIGITS).tolist()
            tiles.append(
                GroundTile(
                    surface="track", x_min_m=low[0], y_min_m=low[1], x_max_m=high[0],
                    y_max_m=high[1],
                )
            )  # fmt: skip
    return tiles


def _read_boundary(plan: FieldSettings, folder: Path) -> FloatArray | None:
    """Read the outer ring of the plan's GeoJSON polygon in the map, (n, 2)."""
    if not plan.boundary:
        return None
    try:
        tree = json.loads(read_text_file(folder / plan.boundary))
        ring = next(
            geometry["coordinates"][0]
            for geometry, properties in list_geometries(tree)
            if geometry["type"] == "Polygon" and properties.get("kind") in {None, "", "boundary"}
        )
        frame = MapFrame(plan.datum)
        places = [frame.map_from_geodetic(point[1], point[0], plan.datum.alt_m) for point in ring]
        return np.array(places, dtype=np.float64)[:, :2]
    except StopIteration as error:
        raise DescriptionError(
            f"boundary {plan.boundary} has no polygon of a field; draw one"
        ) from error
    except (OSError, ValueError, KeyError, IndexError, TypeError, AttributeError) as error:
        raise DescriptionError(
            f"boundary {plan.boundary} is no GeoJSON polygon that can be read: {error!r}; "
            "export it anew"
        ) from error


def _find_inside(
    points: FloatArray, ring: FloatArray
) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """Return which points (n, 2) lie inside a ring (m, 2), by counting the edges to their right."""
    inside = np.zeros(len(points), dtype=bool)
    x, y = points[:, 0], points[:, 1]
    for (x0, y0), (x1, y1) in zip(ring, np.roll(ring, -1, axis=0), strict=True):
        spans = (y0 > y) != (y1 > y)
        rise = y1 - y0 if y1 != y0 else 1.0
        inside ^= spans & (x < x0 + (y - y0) * (x1 - x0) / rise)
    return inside


if __name__ == "__main__":
    for field, field_seed in PACKAGED.items():
        write_world(
            generate_field(read_field_settings(ROOT / "fields" / f"{field}.toml"), field_seed),
            ROOT / "worlds" / f"{field}.world",
        )
