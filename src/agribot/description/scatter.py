"""Procedural plants: crops where the world puts them, weeds at random."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from agribot.core.errors import DescriptionError
from agribot.core.messages import FloatArray, PlantClass
from agribot.core.world import Plant
from agribot.description.elements import SourceFile
from agribot.description.plant_names import NamedPlant
from agribot.description.sdf_models import qualify_tag

MAX_DRAWS = 200  # draws of a place for one weed, before the field counts as full
SEEDS = 2**31


class WeedKind(NamedTuple):
    species: tuple[str, ...]
    height_min_m: float
    height_max_m: float


class Companions(NamedTuple):
    """Weeds around one crop plant."""

    mean_count: float
    radius_m: float
    kind: WeedKind


class Crop(NamedTuple):
    """A crop plant to grow at a place in the map."""

    x_map_m: float
    y_map_m: float
    species: str
    height_m: float
    height_spread_ratio: float
    stem_radius_m: float
    companions: Companions | None


class WeedArea(NamedTuple):
    """A rectangle, in the frame of the world file, with a density of weeds."""

    corner_m: tuple[float, float]
    size_m: tuple[float, float]
    density_per_m2: float
    crop_distance_m: float
    kind: WeedKind

    @property
    def area_m2(self) -> float:
        return self.size_m[0] * self.size_m[1]


def read_crop(model: ET.Element, x_map_m: float, y_map_m: float, source: SourceFile) -> Crop | None:
    """Read the crop that a model declares, or None."""
    element = model.find(qualify_tag("crop"))
    if element is None:
        return None
    where = f"model '{model.get('name')}' <agribot:crop>"

    def read_number(key: str) -> float:
        return source.parse_number(element.get(key), f"{where} {key}")

    return Crop(
        x_map_m=x_map_m,
        y_map_m=y_map_m,
        species=source.require_attribute(element, "species", where),
        height_m=read_number("height_m"),
        height_spread_ratio=read_number("height_spread_ratio"),
        stem_radius_m=read_number("stem_radius_m"),
        companions=_read_companions(model, source),
    )


def read_weed_areas(world: ET.Element, source: SourceFile) -> tuple[WeedArea, ...]:
    areas = []
    for element in world.findall(qualify_tag("weeds")):
        with source.attempt(element):
            areas.append(_read_area(element, source))
    return tuple(areas)


def read_plants(
    world: ET.Element, map_from_world: FloatArray, source: SourceFile
) -> tuple[Plant, ...]:
    """Read the plants that a world lists one by one; `map_from_world` is (4, 4)."""
    plants: list[Plant] = []
    turn_rad = math.atan2(map_from_world[1, 0], map_from_world[0, 0])
    for element in world.findall(qualify_tag("plant")):
        with source.attempt(element):
            plants.append(_read_plant(element, map_from_world, turn_rad, source))
    return tuple(plants)


def _read_plant(
    element: ET.Element, map_from_world: FloatArray, turn_rad: float, source: SourceFile
) -> Plant:
    where = "<agribot:plant>"

    def read_number(key: str) -> float:
        return source.parse_number(element.get(key), f"{where} {key}")

    kind = source.require_attribute(element, "class", where).upper()
    if kind not in {"CROP", "WEED"}:
        raise source.fail(where, f"class '{kind.lower()}' is unknown; write crop or weed")
    x_m, y_m = (map_from_world @ np.array([read_number("x"), read_number("y"), 0.0, 1.0]))[
        :2
    ].tolist()
    return Plant(
        species=source.require_attribute(element, "species", where),
        plant=PlantClass[kind],
        x_map_m=x_m,
        y_map_m=y_m,
        yaw_rad=read_number("yaw") + turn_rad,
        size_m=read_number("height_m"),
        seed=int(read_number("seed")),
        stem_radius_m=read_number("stem_radius_m"),
    )


def grow_plants(
    crops: Sequence[Crop],
    areas: Sequence[WeedArea],
    map_from_world: FloatArray,
    seed: int,
    density_per_m2: float | None,
) -> tuple[Plant, ...]:
    """Grow all plants of a world; crops never change with the weeds' density.

    The density counts every weed: those scattered over an area and those beside its crops.
    `map_from_world` is (4, 4).
    """
    rng = [np.random.default_rng([seed, part]) for part in range(3)]
    plants = [_grow_crop(crop, rng[0]) for crop in crops]
    crops_xy_m = np.array([(crop.x_map_m, crop.y_map_m) for crop in crops]).reshape(-1, 2)
    wanted = sum(area.density_per_m2 * area.area_m2 for area in areas)
    asked = wanted
    if density_per_m2 is not None:
        asked = density_per_m2 * sum(area.area_m2 for area in areas)
    share = asked / wanted if wanted > 0.0 else float(density_per_m2 is None)
    beside = sum(crop.companions.mean_count * share for crop in crops if crop.companions)
    distance_m = max((area.crop_distance_m for area in areas), default=0.0)
    for crop in crops:
        if crop.companions is not None:
            plants += _grow_companions(crop, crop.companions, share, distance_m, crops_xy_m, rng[1])
    for area in areas:
        density = area.density_per_m2 if density_per_m2 is None else density_per_m2
        part = density * area.area_m2 / asked if asked > 0.0 else 0.0
        count = int(rng[2].poisson(max(0.0, density * area.area_m2 - beside * part)))
        plants += _scatter_weeds(area, count, map_from_world, crops_xy_m, rng[2])
    return tuple(plants)


def grow_named_weeds(
    weeds: Sequence[tuple[float, float, NamedPlant]], seed: int
) -> tuple[Plant, ...]:
    """Grow the weeds that names of models speak of, at their places (x, y) in the map."""
    rng = np.random.default_rng([seed, 3])
    return tuple(
        _grow_weed(x_m, y_m, WeedKind((weed.name.species,), weed.height_m, weed.height_m), rng)
        for x_m, y_m, weed in weeds
    )


def _read_kind(element: ET.Element, source: SourceFile, where: str) -> WeedKind:
    low_m, high_m = (
        source.parse_number(element.get(key), f"{where} {key}")
        for key in ("height_min_m", "height_max_m")
    )
    species = tuple(source.require_attribute(element, "species", where).split())
    if not species or not 0.0 < low_m <= high_m:
        raise source.fail(
            where,
            f"{len(species)} species from {low_m:g} to {high_m:g} m; name one or more, and "
            "0 < height_min_m <= height_max_m",
        )
    return WeedKind(species, low_m, high_m)


def _read_companions(model: ET.Element, source: SourceFile) -> Companions | None:
    element = model.find(qualify_tag("companions"))
    if element is None:
        return None
    where = f"model '{model.get('name')}' <agribot:companions>"
    return Companions(
        source.parse_number(element.get("mean_count"), f"{where} mean_count"),
        source.parse_number(element.get("radius_m"), f"{where} radius_m"),
        _read_kind(element, source, where),
    )


def _read_area(element: ET.Element, source: SourceFile) -> WeedArea:
    where = "<agribot:weeds>"
    x_min, x_max, y_min, y_max, density, distance = (
        source.parse_number(element.get(key), f"{where} {key}")
        for key in ("x_min", "x_max", "y_min", "y_max", "density_per_m2", "crop_distance_m")
    )
    if not (x_min < x_max and y_min < y_max and density >= 0.0):
        raise source.fail(
            where,
            f"x from {x_min:g} to {x_max:g}, y from {y_min:g} to {y_max:g}, {density:g} weeds per "
            "m2; write the smaller first, and a density of 0 or more",
        )
    return WeedArea(
        (x_min, y_min), (x_max - x_min, y_max - y_min), density, distance,
        _read_kind(element, source, where),
    )  # fmt: skip


def _grow_crop(crop: Crop, rng: np.random.Generator) -> Plant:
    spread = crop.height_spread_ratio
    return Plant(
        species=crop.species,
        plant=PlantClass.CROP,
        x_map_m=crop.x_map_m,
        y_map_m=crop.y_map_m,
        yaw_rad=float(rng.uniform(-math.pi, math.pi)),
        size_m=crop.height_m * float(rng.uniform(1.0 - spread, 1.0 + spread)),
        seed=int(rng.integers(SEEDS)),
        stem_radius_m=crop.stem_radius_m,
    )


def _grow_weed(x_map_m: float, y_map_m: float, kind: WeedKind, rng: np.random.Generator) -> Plant:
    return Plant(
        species=kind.species[int(rng.integers(len(kind.species)))],
        plant=PlantClass.WEED,
        x_map_m=x_map_m,
        y_map_m=y_map_m,
        yaw_rad=float(rng.uniform(-math.pi, math.pi)),
        size_m=float(rng.uniform(kind.height_min_m, kind.height_max_m)),
        seed=int(rng.integers(SEEDS)),
    )


def _is_free(x_m: float, y_m: float, crops_xy_m: FloatArray, distance_m: float) -> bool:
    gaps = np.hypot(crops_xy_m[:, 0] - x_m, crops_xy_m[:, 1] - y_m)
    return bool((gaps >= distance_m).all())


def _grow_companions(
    crop: Crop,
    companions: Companions,
    share: float,
    distance_m: float,
    crops_xy_m: FloatArray,
    rng: np.random.Generator,
) -> list[Plant]:
    weeds = []
    for _ in range(int(rng.poisson(companions.mean_count * share))):
        for _ in range(MAX_DRAWS):
            # Uniform over the ring: its area grows with the radius squared.
            square_m2 = rng.uniform(distance_m**2, max(companions.radius_m, distance_m) ** 2)
            angle = rng.uniform(-math.pi, math.pi)
            x_m = crop.x_map_m + math.sqrt(square_m2) * math.cos(angle)
            y_m = crop.y_map_m + math.sqrt(square_m2) * math.sin(angle)
            if _is_free(x_m, y_m, crops_xy_m, distance_m):
                weeds.append(_grow_weed(x_m, y_m, companions.kind, rng))
                break
        else:
            raise _make_no_room_error(distance_m)
    return weeds


def _scatter_weeds(
    area: WeedArea,
    count: int,
    map_from_world: FloatArray,
    crops_xy_m: FloatArray,
    rng: np.random.Generator,
) -> list[Plant]:
    weeds = []
    for _ in range(count):
        for _ in range(MAX_DRAWS):
            at_m = np.array(area.corner_m) + rng.uniform(size=2) * np.array(area.size_m)
            x_m, y_m = (map_from_world @ np.array([*at_m, 0.0, 1.0]))[:2].tolist()
            if _is_free(x_m, y_m, crops_xy_m, area.crop_distance_m):
                weeds.append(_grow_weed(x_m, y_m, area.kind, rng))
                break
        else:
            raise _make_no_room_error(area.crop_distance_m)
    return weeds


def _make_no_room_error(distance_m: float) -> DescriptionError:
    return DescriptionError(
        f"no place for a weed {distance_m:g} m from every crop after {MAX_DRAWS} draws; "
        "make crop_distance_m smaller"
    )
