"""The settings of a field to be generated: those of a FIELD.toml."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import msgspec

from agribot.core.errors import ConfigError, DescriptionError
from agribot.core.geo import Datum
from agribot.core.toml_tree import read_toml
from agribot.core.world import SoilClass

# Limits that no field exceeds, so that a typing error cannot exhaust the memory.
LARGEST_M = 1e4
MOST_PLANTS = 200_000
Positive = Annotated[float, msgspec.Meta(gt=0, le=LARGEST_M)]
NonNegative = Annotated[float, msgspec.Meta(ge=0, le=LARGEST_M)]
Ratio = Annotated[float, msgspec.Meta(ge=0, le=1)]


class FieldSection(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Base of the settings."""


class RowsSettings(FieldSection, frozen=True):
    """Parallel rows; each further one lies `pitch_m` to the right of the row direction.

    `curvature_radpm` bends them, to the left where it is positive. After every
    `tramline_every` rows there is `tramline_m` more room (0: no tramlines).
    """

    count: Annotated[int, msgspec.Meta(ge=1, le=1000)] = 6  # number of rows
    # Distance of the first plant and the last.
    length_m: Annotated[float, msgspec.Meta(gt=0, le=1000)] = 10.0
    pitch_m: Positive = 1.0  # distance of neighbouring rows
    first_row_start_map_m: tuple[float, float] = (1.0, 2.0)  # the first plant of the first row
    # Direction of the rows, counter-clockwise from East.
    yaw_deg: Annotated[float, msgspec.Meta(ge=-360, le=360)] = 90.0
    # Left positive; 0: straight.
    curvature_radpm: Annotated[float, msgspec.Meta(ge=-0.2, le=0.2)] = 0.0
    tramline_every: Annotated[int, msgspec.Meta(ge=0)] = 0  # rows between two tramlines; 0: none
    tramline_m: NonNegative = 0.5  # more room where one lies
    # A GeoJSON file beside this one whose lines are the rows, any lines; "": those above.
    file: str = ""


class CropSettings(FieldSection, frozen=True):
    """Crop plants of `height_m`; gaps are stretches of a row without plants."""

    # One of `sugar_beet`, `lettuce`, `maize`, `carrot`, `onion`, `parsley`.
    species: str = "sugar_beet"
    spacing_m: Annotated[float, msgspec.Meta(ge=0.02)] = 0.25  # distance of neighbouring plants
    height_m: Positive = 0.2  # height of the plants
    # Largest deviation of the heights, both ways.
    height_spread_ratio: Annotated[float, msgspec.Meta(ge=0, le=0.9)] = 0.1
    stem_radius_m: NonNegative = 0.02  # radius within which a wheel crushes the plant
    jitter_m: NonNegative = 0.0  # off its place, both ways at most
    missing_ratio: Ratio = 0.0  # share of plants that did not come up
    # Stretches where nothing came up, on average.
    gaps_per_row: Annotated[float, msgspec.Meta(ge=0, le=100)] = 0.0
    gap_length_m: Positive = 1.0  # length of such a stretch


class WeedsSettings(FieldSection, frozen=True):
    """Weeds over the field and `margin_m` around it; `cluster_ratio` of them in patches."""

    # Over the field and its margin.
    density_per_m2: Annotated[float, msgspec.Meta(ge=0, le=100)] = 1.5
    # Species that grow, each as often.
    species: tuple[str, ...] = ("grass", "goosefoot", "thistle", "amaranth")
    height_min_m: Positive = 0.04  # height of the smallest
    height_max_m: Positive = 0.15  # height of the tallest
    crop_distance_m: NonNegative = 0.1  # none stands nearer to a crop plant
    margin_m: NonNegative = 0.5  # around the rows, in which weeds grow too
    cluster_ratio: Ratio = 0.0  # share of the weeds that stand in patches
    # Weeds in a patch, on average.
    cluster_size: Annotated[float, msgspec.Meta(ge=1, le=1000)] = 6.0
    cluster_radius_m: Positive = 0.3  # radius of a patch, in which most of it lies


class SoilSettings(FieldSection, frozen=True):
    """Residue, stones and wet patches on the soil, 0 none to 1 a lot, how it carries, and tracks.

    On a `rigid` soil nothing sinks in; the others give way, the more the wetter they are.
    Tracks are `track_width_m` wide and `track_gauge_m` apart (0: none), one pair astride each
    row; rows must be straight and along an axis of the map.
    """

    residue_ratio: Ratio = 0.0  # straw and leaves: 0 none, 1 a lot
    stones_ratio: Ratio = 0.0  # 0 none, 1 a lot
    wet_ratio: Ratio = 0.0  # 0 dry, 1 wet all over
    soil_class: SoilClass = "rigid"  # rigid, firm, tilled, soft
    moisture_ratio: Ratio = 0.0  # 0 dry, 1 saturated
    # Between the tracks of earlier passes; 0: none.
    track_gauge_m: Annotated[float, msgspec.Meta(ge=0, le=5)] = 0.0
    track_width_m: Annotated[float, msgspec.Meta(gt=0, le=1)] = 0.1  # width of one track


class ReliefSettings(FieldSection, frozen=True):
    """Heights of the soil below the size of a field: rough ground, clods, ridges under the rows.

    Tracks of `track_depth_m` need `soil.track_gauge_m` and lie where those tracks do.
    """

    # Deviation from the plane; 0.006 a seedbed, 0.014 a tilled field, 0.02 a rough one.
    roughness_rms_m: Annotated[float, msgspec.Meta(ge=0, le=0.1)] = 0.0
    clods_per_m2: Annotated[float, msgspec.Meta(ge=0, le=200)] = 0.0  # 25 on a tilled field
    clod_height_m: Annotated[float, msgspec.Meta(gt=0, le=0.1)] = 0.03  # height of the highest
    # Height from furrow to crest.
    ridge_height_m: Annotated[float, msgspec.Meta(ge=0, le=0.5)] = 0.0
    track_depth_m: Annotated[float, msgspec.Meta(ge=0, le=0.2)] = 0.0  # depth of the wheel tracks


class FieldSettings(FieldSection, frozen=True):
    """A whole field; `boundary` is a GeoJSON polygon beside the file that holds all plants."""

    name: str = "field"  # name of the field
    datum: Datum = Datum(lat_deg=21.161289, lon_deg=72.787022)  # the origin of the map on Earth
    spawn_xy_map_m: tuple[float, float] = (-2.0, 0.0)  # place where the robot is put down
    # Its heading there, counter-clockwise from East.
    spawn_yaw_deg: Annotated[float, msgspec.Meta(ge=-360, le=360)] = 90.0
    boundary: str = ""  # a GeoJSON polygon beside the file; plants stand inside it only
    rows: RowsSettings = RowsSettings()
    crop: CropSettings = CropSettings()
    weeds: WeedsSettings = WeedsSettings()
    soil: SoilSettings = SoilSettings()
    relief: ReliefSettings = ReliefSettings()


def read_field_settings(path: Path) -> FieldSettings:
    """Read a FIELD.toml.

    Raises: DescriptionError: no such file, not TOML, an unknown key or a value out of range.
    """
    try:
        tree = read_toml(path)
        _check_numbers(tree, path.name, "")
        plan = msgspec.convert(tree, FieldSettings)
    except ConfigError as error:
        raise DescriptionError(str(error)) from error
    except msgspec.ValidationError as error:
        raise DescriptionError(
            f"{path.name}: {error}; see agribot world generate --help"
        ) from error
    if plan.weeds.height_min_m > plan.weeds.height_max_m or not plan.weeds.species:
        raise DescriptionError(
            f"{path.name}: weeds of {len(plan.weeds.species)} species from "
            f"{plan.weeds.height_min_m:g} to {plan.weeds.height_max_m:g} m; name one species or "
            "more, and a height_min_m that is not above height_max_m"
        )
    if plan.relief.track_depth_m and not plan.soil.track_gauge_m:
        raise DescriptionError(
            f"{path.name}: relief.track_depth_m is {plan.relief.track_depth_m:g}, but there are no "
            "tracks; set soil.track_gauge_m"
        )
    if plan.rows.file and plan.soil.track_gauge_m:
        raise DescriptionError(
            f"{path.name}: soil.track_gauge_m lays tracks along rows of [rows] only, not along "
            "those of rows.file; set it to 0"
        )
    _check_size(plan, path.name)
    return plan


def _check_numbers(value: object, file: str, at: str) -> None:
    """Check that numbers are finite and not larger than a field; TOML allows nan and inf."""
    if isinstance(value, dict):
        for key, inner in value.items():
            _check_numbers(inner, file, f"{at}.{key}" if at else str(key))
    elif isinstance(value, list):
        for inner in value:
            _check_numbers(inner, file, at)
    elif isinstance(value, (int, float)) and not abs(value) <= MOST_PLANTS:
        raise DescriptionError(f"{file}: {at} = {value}: out of range; give at most {MOST_PLANTS}")


def _check_size(plan: FieldSettings, file: str) -> None:
    rows, weeds = plan.rows, plan.weeds
    crops = rows.count * (rows.length_m / plan.crop.spacing_m + 1.0)
    breadth_m = (rows.count - 1) * rows.pitch_m + 2.0 * weeds.margin_m
    if rows.tramline_every:
        breadth_m += (rows.count // rows.tramline_every) * rows.tramline_m
    wild = weeds.density_per_m2 * breadth_m * (rows.length_m + 2.0 * weeds.margin_m)
    if crops + wild > MOST_PLANTS:
        raise DescriptionError(
            f"{file}: about {crops:.3g} crop plants and {wild:.3g} weeds are asked for; a field "
            f"may have {MOST_PLANTS} plants: lower rows.count, rows.length_m or "
            "weeds.density_per_m2, or raise crop.spacing_m"
        )
