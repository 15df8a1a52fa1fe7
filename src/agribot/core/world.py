"""What a world is: the values that an SDF world file was read into.

Everything is in the map frame (East-North-Up at the world's datum), whatever orientation the
file used. Plants are procedural: a species, a growth stage and a seed, never a rigid body.
"""

from __future__ import annotations

import math
from typing import Literal

import msgspec

from agribot.core.geo import Datum, wrap_rad
from agribot.core.messages import FloatArray, PlantClass, Row, Vec3
from agribot.core.robot import Shape

Rgb = tuple[float, float, float]


class Plant(msgspec.Struct, frozen=True, kw_only=True):
    """A plant standing at a place. `size_m` is about its height; `seed` fixes its shape."""

    species: str
    plant: PlantClass
    x_map_m: float
    y_map_m: float
    yaw_rad: float
    size_m: float
    seed: int
    stem_radius_m: float = 0.02


class Obstacle(msgspec.Struct, frozen=True, kw_only=True):
    """A fixed thing that the robot can hit and the camera can see."""

    name: str
    kind: str
    x_map_m: float
    y_map_m: float
    z_map_m: float
    yaw_rad: float
    shapes: tuple[Shape, ...]
    collides: bool = True


class Waypoint(msgspec.Struct, frozen=True, kw_only=True):
    """Place of a walker at a time of its walk."""

    t_s: float
    x_map_m: float
    y_map_m: float
    yaw_rad: float


class Walker(msgspec.Struct, frozen=True, kw_only=True):
    """A person or an animal that follows its waypoints, whatever stands in the way.

    `kind` names the figure, such as person_walking; `shapes` are its parts. The walk begins at
    `delay_s`; with `loops` it begins anew after its last waypoint, else it stops there.
    """

    name: str
    kind: str
    shapes: tuple[Shape, ...]
    waypoints: tuple[Waypoint, ...]
    loops: bool = True
    delay_s: float = 0.0

    def find_place(self, t_s: float) -> tuple[float, float, float]:
        """Return x, y and yaw in the map: straight from waypoint to waypoint."""
        points = self.waypoints
        walked_s = max(t_s - self.delay_s, 0.0)
        if self.loops and points[-1].t_s > 0.0:
            walked_s = math.fmod(walked_s, points[-1].t_s)
        after = next((k for k, point in enumerate(points) if point.t_s > walked_s), len(points))
        start, end = points[max(after - 1, 0)], points[min(after, len(points) - 1)]
        share = (walked_s - start.t_s) / (end.t_s - start.t_s) if end.t_s > start.t_s else 0.0
        share = max(share, 0.0)
        return (
            start.x_map_m + (end.x_map_m - start.x_map_m) * share,
            start.y_map_m + (end.y_map_m - start.y_map_m) * share,
            wrap_rad(start.yaw_rad + wrap_rad(end.yaw_rad - start.yaw_rad) * share),
        )


def is_person(kind: str) -> bool:
    """Return whether a kind of obstacle or walker is a person."""
    return kind.lower().startswith("person")


class GroundTile(msgspec.Struct, frozen=True, kw_only=True):
    """An axis-aligned rectangle of one surface: "soil", "grass", "track"; later ones win."""

    surface: str
    x_min_m: float
    y_min_m: float
    x_max_m: float
    y_max_m: float


class GripPatch(msgspec.Struct, frozen=True, kw_only=True):
    """An axis-aligned rectangle of ground with a friction of its own; later ones win."""

    friction_ratio: float
    x_min_m: float
    y_min_m: float
    x_max_m: float
    y_max_m: float


class Light(msgspec.Struct, frozen=True, kw_only=True):
    """The sun: the unit vector points from the ground to the sun, map frame."""

    to_sun: Vec3 = (0.48, -0.10, 0.87)
    diffuse: float = 0.75
    ambient: float = 0.5


class Soil(msgspec.Struct, frozen=True, kw_only=True):
    """Cover of the soil beyond its usual crumbs, each 0 (nothing) to 1 (a lot).

    `residue_ratio` straw and stalks of the last crop, `stones_ratio` stones, `wet_ratio` the
    share of the ground that is dark with water.
    """

    residue_ratio: float = 0.0
    stones_ratio: float = 0.0
    wet_ratio: float = 0.0


SoilClass = Literal["rigid", "firm", "tilled", "soft"]


class SoilStrength(msgspec.Struct, frozen=True, kw_only=True):
    """Strength of the soil: on a `rigid` one nothing sinks in; water weakens the others.

    `moisture_ratio` goes from 0 (dry) to 1 (saturated).
    """

    soil_class: SoilClass = "rigid"
    moisture_ratio: float = 0.0


class HeightField(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Terrain: `height_m` (rows along y, columns along x), first sample at x_min_m, y_min_m."""

    height_m: FloatArray
    x_min_m: float
    y_min_m: float
    resolution_m: float


class Relief(msgspec.Struct, frozen=True, kw_only=True):
    """Heights of the ground below the size of a field, drawn from `seed`; 0: flat.

    `roughness_rms_m` is the deviation from the plane of random ground with an ISO 8608 spectrum.
    Clods have heights up to `clod_height_m`. A ridge of `ridge_height_m` runs under each of
    `rows`, with furrows between them; wheel tracks of `track_depth_m` run astride each row.
    """

    seed: int = 0
    roughness_rms_m: float = 0.0
    clods_per_m2: float = 0.0
    clod_height_m: float = 0.03
    ridge_height_m: float = 0.0
    track_depth_m: float = 0.0
    track_gauge_m: float = 0.0
    track_width_m: float = 0.2
    rows: tuple[Row, ...] = ()


class RowTable(msgspec.Struct, frozen=True, kw_only=True):
    """The parallel crop rows of a world, under the names of the settings in `field`."""

    first_row_start_map_m: tuple[float, float]
    row_yaw_deg: float
    row_length_m: float
    row_curvature_radpm: float = 0.0
    row_pitch_m: float
    row_count: int
    plant_spacing_m: float | None = None
    has_crop: bool = True  # whether crop of the world stands in them


class WorldSpec(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """`datum` is where the map lies on Earth; a world that states no place is not `is_placed`.

    `rows` are its crop rows, None where it has none or they are no table.
    """

    name: str
    datum: Datum
    is_placed: bool = True
    rows: RowTable | None = None
    spawn_xy_map_m: tuple[float, float] = (0.0, 0.0)
    spawn_yaw_map_rad: float = 0.0
    gravity_mps2: float = 9.8
    field_enu_t: Vec3 = (0.0, 3.8e-5, -2.3e-5)  # about what a compass meets at 21 N, 73 E
    friction_ratio: float = 1.0  # friction of the ground outside the patches
    grip: tuple[GripPatch, ...] = ()
    light: Light = Light()
    ground: tuple[GroundTile, ...] = ()
    soil: Soil = Soil()
    strength: SoilStrength = SoilStrength()
    terrain: HeightField | None = None
    relief: Relief = Relief()
    plants: tuple[Plant, ...] = ()
    obstacles: tuple[Obstacle, ...] = ()
    walkers: tuple[Walker, ...] = ()
    warnings: tuple[str, ...] = ()
