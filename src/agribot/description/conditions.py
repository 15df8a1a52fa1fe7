"""How the world of a run differs from its map, and the robot from its description.

A preset sets the limits and each seed draws from them. The robot does not know the drawn values.
"""

from __future__ import annotations

import math
import tomllib
import zlib
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np

from agribot.core.errors import ConfigError, add_advice
from agribot.core.messages import Row
from agribot.core.suggestions import suggest_name
from agribot.core.toml_tree import read_toml
from agribot.core.world import SoilClass

NonNegative = Annotated[float, msgspec.Meta(ge=0, le=1e3)]
Share = Annotated[float, msgspec.Meta(ge=0, le=1)]
Between = tuple[NonNegative, NonNegative]
ShareBetween = tuple[Share, Share]
NOTHING = (0.0, 0.0)


class Preset(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Spreads of a world: 1 sigma where a name says `std`, pairs are drawn between.

    Rows are off their map by one offset, turn and stretch of the whole field, and each by an
    offset of its own; plants stand about their row.
    """

    about: str
    start_std_m: NonNegative = 0.0
    start_yaw_std_deg: NonNegative = 0.0
    soil_classes: tuple[SoilClass, ...] = ("rigid",)
    moisture_ratio: ShareBetween = NOTHING
    friction_ratio: Between | None = None  # friction of the ground at large; None: the world's own
    roughness_rms_m: Between = NOTHING
    clods_per_m2: Between = NOTHING
    clod_height_m: Between = NOTHING
    ridge_height_m: Between = NOTHING
    residue_ratio: ShareBetween | None = None  # None: the world's own, as for the next one
    stones_ratio: ShareBetween | None = None
    sowing_across_std_m: NonNegative = 0.0
    sowing_along_std_m: NonNegative = 0.0
    missing_ratio: Share = 0.0
    gaps_per_row: NonNegative = 0.0
    gap_length_m: Between = NOTHING
    double_ratio: Share = 0.0
    missing_row_ratio: Share = 0.0
    growth_ratio: Between = (1.0, 1.0)
    map_offset_std_m: NonNegative = 0.0
    map_turn_std_deg: NonNegative = 0.0
    map_stretch_std_ratio: NonNegative = 0.0
    row_offset_std_m: NonNegative = 0.0
    camera_height_std_m: NonNegative = 0.0
    camera_angle_std_deg: NonNegative = 0.0
    wheel_wear_ratio: ShareBetween = NOTHING
    sun_elevation_deg: tuple[float, float] | None = None  # None: the world's own sun
    cloud_ratio: ShareBetween = NOTHING

    @property
    def is_exact(self) -> bool:
        """True where nothing differs from the files of world and robot."""
        return self == Preset(about=self.about)


class Conditions(msgspec.Struct, frozen=True, kw_only=True):
    """Values that a seed drew. Offsets are the truth less the map or the description.

    The field is turned and stretched about `centre_map_m`; `row_offsets_m` are to the left of
    each row, `camera_angles_deg` about the axes of the body, forward, left and up.
    """

    start_offset_m: tuple[float, float]
    start_turn_deg: float
    soil_class: SoilClass
    moisture_ratio: float
    friction_ratio: float | None
    roughness_rms_m: float
    clods_per_m2: float
    clod_height_m: float
    ridge_height_m: float
    residue_ratio: float | None
    stones_ratio: float | None
    growth_ratio: float
    centre_map_m: tuple[float, float]
    map_offset_m: tuple[float, float]
    map_turn_deg: float
    map_stretch_ratio: float
    row_offsets_m: tuple[float, ...]
    rows_missing: tuple[int, ...]
    camera_height_m: float
    camera_angles_deg: tuple[float, float, float]
    wheel_wear_ratio: float
    sun_elevation_deg: float | None
    sun_azimuth_deg: float | None
    cloud_ratio: float

    def move_to_truth(self, x_map_m: float, y_map_m: float) -> tuple[float, float]:
        """Return where a place of the map truly is in the field, apart from its row's offset."""
        (cx, cy), turn_rad = self.centre_map_m, math.radians(self.map_turn_deg)
        scale = 1.0 + self.map_stretch_ratio
        cos, sin = scale * math.cos(turn_rad), scale * math.sin(turn_rad)
        dx, dy = x_map_m - cx, y_map_m - cy
        return (
            cx + self.map_offset_m[0] + cos * dx - sin * dy,
            cy + self.map_offset_m[1] + sin * dx + cos * dy,
        )

    def find_true_row(self, row: Row) -> Row:
        """Return the line that the plants of a row truly stand about."""
        start = self.move_to_truth(*row.start_map_m)
        end = self.move_to_truth(*row.end_map_m)
        length_m = math.dist(start, end) or 1.0
        own_m = self.row_offsets_m[row.index] if row.index < len(self.row_offsets_m) else 0.0
        left = -(end[1] - start[1]) / length_m * own_m, (end[0] - start[0]) / length_m * own_m
        return msgspec.structs.replace(
            row,
            start_map_m=(start[0] + left[0], start[1] + left[1]),
            end_map_m=(end[0] + left[0], end[1] + left[1]),
            curvature_radpm=row.curvature_radpm / (1.0 + self.map_stretch_ratio),
        )


def list_condition_presets() -> list[str]:
    files = resources.files("agribot.description") / "presets"
    return sorted(p.name.removesuffix(".toml") for p in files.iterdir())


def load_condition_preset(name_or_path: str) -> Preset:
    """Read a packaged preset or a TOML file.

    Raises: ConfigError: unknown name, no such file, or a value that cannot be.
    """
    known = list_condition_presets()
    path = Path(name_or_path)
    if name_or_path in known:
        packaged = resources.files("agribot.description") / "presets" / f"{name_or_path}.toml"
        tree = tomllib.loads(packaged.read_text(encoding="utf-8"))
    elif path.suffix != ".toml":
        raise ConfigError(
            f"sim.preset: unknown preset '{name_or_path}'{suggest_name(name_or_path, known)}; "
            f"known: {', '.join(known)}, or a path to a .toml file"
        )
    else:
        tree = read_toml(path)
    try:
        preset = msgspec.convert(tree, Preset)
    except msgspec.ValidationError as error:
        fact = f"preset {name_or_path}: {error}"
        raise ConfigError(add_advice(fact, "see the packaged presets")) from error
    _check_pairs(preset, name_or_path)
    return preset


def _check_pairs(preset: Preset, source: str) -> None:
    """Refuse pairs the wrong way round, and a preset without a soil."""
    for name, value in msgspec.structs.asdict(preset).items():
        is_pair = isinstance(value, tuple) and len(value) == 2 and name != "soil_classes"
        if is_pair and value[0] > value[1]:
            raise ConfigError(
                f"preset {source}: {name} = {list(value)}: not in order; write the smaller first"
            )
    if not preset.soil_classes:
        raise ConfigError(f"preset {source}: soil_classes is empty; name at least one class")


class _Draw:
    """One random stream for each condition: a new condition changes no other one."""

    def __init__(self, seed: int) -> None:
        self._seed = seed

    def stream(self, name: str) -> np.random.Generator:
        return make_condition_stream(self._seed, name)

    def normal(self, name: str, std: float, count: int = 1) -> Any:
        """Draw within three sigma."""
        drawn = np.clip(self.stream(name).standard_normal(count), -3.0, 3.0) * std
        return tuple(drawn.tolist()) if count > 1 else float(drawn[0])

    def between(self, name: str, low_high: tuple[float, float]) -> float:
        return float(self.stream(name).uniform(*low_high))

    def between_or_own(self, name: str, low_high: tuple[float, float] | None) -> float | None:
        return None if low_high is None else self.between(name, low_high)


def make_condition_stream(seed: int, name: str) -> np.random.Generator:
    """Make the random stream of one condition; it depends on the seed and the name only."""
    return np.random.default_rng([seed, zlib.crc32(name.encode())])


def draw_conditions(preset: Preset, seed: int, rows: Sequence[Row]) -> Conditions:
    """Draw what the world of a seed is like; `rows` are those of the map."""
    draw = _Draw(seed)
    ends = np.array([end for row in rows for end in (row.start_map_m, row.end_map_m)])
    centre = ends.mean(axis=0).tolist() if len(ends) else [0.0, 0.0]
    classes = preset.soil_classes
    has_sun = preset.sun_elevation_deg is not None
    own_m = draw.stream("row offsets").standard_normal(len(rows)).clip(-3.0, 3.0)
    missing = draw.stream("missing rows").uniform(size=len(rows)) < preset.missing_row_ratio
    return Conditions(
        start_offset_m=draw.normal("start", preset.start_std_m, 2),
        start_turn_deg=draw.normal("start yaw", preset.start_yaw_std_deg),
        soil_class=classes[int(draw.stream("soil class").integers(len(classes)))],
        moisture_ratio=draw.between("moisture", preset.moisture_ratio),
        friction_ratio=draw.between_or_own("friction", preset.friction_ratio),
        roughness_rms_m=draw.between("roughness", preset.roughness_rms_m),
        clods_per_m2=draw.between("clods", preset.clods_per_m2),
        clod_height_m=draw.between("clod height", preset.clod_height_m),
        ridge_height_m=draw.between("ridges", preset.ridge_height_m),
        residue_ratio=draw.between_or_own("residue", preset.residue_ratio),
        stones_ratio=draw.between_or_own("stones", preset.stones_ratio),
        growth_ratio=draw.between("growth", preset.growth_ratio),
        centre_map_m=(centre[0], centre[1]),
        map_offset_m=draw.normal("map offset", preset.map_offset_std_m, 2),
        map_turn_deg=draw.normal("map turn", preset.map_turn_std_deg),
        map_stretch_ratio=draw.normal("map stretch", preset.map_stretch_std_ratio),
        row_offsets_m=tuple((preset.row_offset_std_m * own_m).tolist()),
        rows_missing=tuple(np.flatnonzero(missing).tolist()),
        camera_height_m=draw.normal("camera height", preset.camera_height_std_m),
        camera_angles_deg=draw.normal("camera angles", preset.camera_angle_std_deg, 3),
        wheel_wear_ratio=draw.between("wheel wear", preset.wheel_wear_ratio),
        sun_elevation_deg=draw.between_or_own("sun elevation", preset.sun_elevation_deg),
        sun_azimuth_deg=draw.between("sun azimuth", (0.0, 360.0)) if has_sun else None,
        cloud_ratio=draw.between("clouds", preset.cloud_ratio),
    )
