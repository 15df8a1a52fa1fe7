"""Writing a world as SDF that other simulators open and `load_world` reads back."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path

import msgspec
import numpy as np

from agribot.core.errors import DescriptionError, explain_os_error
from agribot.core.robot import Shape
from agribot.core.world import (
    GripPatch,
    GroundTile,
    HeightField,
    Obstacle,
    Plant,
    Relief,
    RowTable,
    Soil,
    SoilStrength,
    Walker,
    WorldSpec,
)
from agribot.description.sdf_models import NAMESPACE, qualify_tag

COLOURS = {
    "soil": "0.42 0.32 0.24 1", "grass": "0.3 0.45 0.2 1", "pavement": "0.45 0.45 0.45 1",
    "gravel": "0.5 0.48 0.45 1", "track": "0.38 0.3 0.23 1",
}  # fmt: skip
SUN_DISTANCE_M = 10.0
SKIN = "walk.dae"  # mesh of Gazebo's own media
LAYER_M = 0.002  # one surface over the other, so that they do not flicker in other simulators


def write_world(world: WorldSpec, path: Path) -> None:
    """Write a world in the frame of the map; terrain goes into a .npy file beside it.

    Raises: DescriptionError: a place that cannot be written.
    """
    root = build_world_element(world, f"{path.stem}.npy")
    ET.indent(root)
    ET.register_namespace("agribot", NAMESPACE)
    text = ET.tostring(root, encoding="unicode")
    with explain_os_error(f"cannot write {path}", "choose another", DescriptionError):
        path.write_text(f'<?xml version="1.0"?>\n{text}\n', encoding="utf-8")
        if world.terrain is not None:
            np.save(path.with_suffix(".npy"), world.terrain.height_m)


def build_world_element(world: WorldSpec, terrain_file: str) -> ET.Element:
    """Build the <sdf> tree of a world; its frame is the map: x East, y North, z up."""
    root = ET.Element("sdf", {"version": "1.9"})
    top = ET.SubElement(root, "world", {"name": world.name})
    _add_text(top, "gravity", (0.0, 0.0, -world.gravity_mps2))
    _add_text(top, "magnetic_field", world.field_enu_t)
    place = ET.SubElement(top, "spherical_coordinates")
    _add_text(place, "surface_model", "EARTH_WGS84")
    _add_text(place, "world_frame_orientation", "ENU")
    _add_text(place, "latitude_deg", (world.datum.lat_deg,))
    _add_text(place, "longitude_deg", (world.datum.lon_deg,))
    _add_text(place, "elevation", (world.datum.alt_m,))
    _add_text(place, "heading_deg", "0")
    _add_light(top, world)
    spawn = ET.SubElement(top, "frame", {"name": "robot_spawn"})
    _add_text(spawn, "pose", (*world.spawn_xy_map_m, 0.0, 0.0, 0.0, world.spawn_yaw_map_rad))
    _add_ground(top, world, terrain_file)
    if world.soil != Soil():
        values = msgspec.to_builtins(world.soil)
        ET.SubElement(
            top, qualify_tag("soil"), {name: repr(value) for name, value in values.items()}
        )
    if world.rows is not None:
        _add_rows(top, world.rows)
    if world.relief != Relief():
        _add_relief(top, world.relief)
    if world.strength != SoilStrength():
        moisture = repr(float(world.strength.moisture_ratio))
        ET.SubElement(
            top,
            qualify_tag("strength"),
            {"soil_class": world.strength.soil_class, "moisture_ratio": moisture},
        )
    names: set[str] = set()
    for obstacle in world.obstacles:
        _add_obstacle(top, obstacle, names)
    for walker in world.walkers:
        _add_walker(top, walker)
    for plant in world.plants:
        _add_plant(top, plant)
    return root


def _add_text(parent: ET.Element, name: str, value: str | tuple[float, ...]) -> ET.Element:
    element = ET.SubElement(parent, name)
    element.text = value if isinstance(value, str) else " ".join(repr(float(v)) for v in value)
    return element


def _add_rows(top: ET.Element, rows: RowTable) -> None:
    values = {
        "x": rows.first_row_start_map_m[0], "y": rows.first_row_start_map_m[1],
        "yaw_deg": rows.row_yaw_deg, "length_m": rows.row_length_m, "pitch_m": rows.row_pitch_m,
        "count": rows.row_count, "curvature_radpm": rows.row_curvature_radpm,
    }  # fmt: skip
    if rows.plant_spacing_m is not None:
        values["spacing_m"] = rows.plant_spacing_m
    texts = {name: repr(value) for name, value in values.items()}
    ET.SubElement(top, qualify_tag("rows"), texts)


def _add_relief(top: ET.Element, relief: Relief) -> None:
    values = {
        name: repr(getattr(relief, name)) for name in Relief.__struct_fields__ if name != "rows"
    }
    element = ET.SubElement(top, qualify_tag("relief"), values)
    for row in relief.rows:
        line = {
            "start": " ".join(map(repr, row.start_map_m)),
            "end": " ".join(map(repr, row.end_map_m)),
            "curvature_radpm": repr(row.curvature_radpm),
        }
        ET.SubElement(element, qualify_tag("row"), line)


def _add_light(top: ET.Element, world: WorldSpec) -> None:
    light = world.light
    scene = ET.SubElement(top, "scene")
    _add_text(scene, "ambient", (light.ambient,) * 3 + (1.0,))
    _add_text(scene, "background", (0.7, 0.7, 0.7, 1.0))
    sun = ET.SubElement(top, "light", {"name": "sun", "type": "directional"})
    _add_text(sun, "cast_shadows", "true")
    _add_text(sun, "pose", (0.0, 0.0, SUN_DISTANCE_M, 0.0, 0.0, 0.0))
    _add_text(sun, "diffuse", (light.diffuse,) * 3 + (1.0,))
    _add_text(sun, "direction", tuple(-value for value in light.to_sun))


def _add_ground(top: ET.Element, world: WorldSpec, terrain_file: str) -> None:
    model = ET.SubElement(top, "model", {"name": "ground"})
    _add_text(model, "static", "true")
    link = ET.SubElement(model, "link", {"name": "link"})
    felt = ET.SubElement(link, "collision", {"name": "ground_collision"})
    land = world.terrain
    tiles = world.ground
    if land is not None:
        _add_height_map(felt, land, terrain_file)
        seen = ET.SubElement(link, "visual", {"name": "land"})
        _add_height_map(seen, land, terrain_file)
        tiles = tiles[1:]  # the first one is the terrain itself
    else:
        _add_rectangle(felt, _find_hull([*tiles, *world.grip] if world.grip else tiles[:1]), 0.0)
    _add_grip(felt, world.friction_ratio)
    for index, patch in enumerate(world.grip):
        part = ET.SubElement(link, "collision", {"name": f"grip_{index}"})
        _add_plate(part, patch, (index + 1) * LAYER_M)
        _add_grip(part, patch.friction_ratio)
    for index, tile in enumerate(tiles):
        visual = ET.SubElement(link, "visual", {"name": f"{tile.surface}_{index + 1}"})
        _add_rectangle(visual, tile, index * LAYER_M)
        material = ET.SubElement(visual, "material")
        for light in ("ambient", "diffuse"):
            _add_text(material, light, COLOURS.get(tile.surface, "0.5 0.5 0.5 1"))
        _add_text(visual, qualify_tag("surface"), tile.surface)


def _add_grip(part: ET.Element, friction_ratio: float) -> None:
    ode = ET.SubElement(ET.SubElement(ET.SubElement(part, "surface"), "friction"), "ode")
    _add_text(ode, "mu", (friction_ratio,))
    _add_text(ode, "mu2", (friction_ratio,))


def _find_hull(tiles: Sequence[GroundTile | GripPatch]) -> GroundTile:
    """Return the rectangle around rectangles."""
    return GroundTile(
        surface="",
        x_min_m=min(tile.x_min_m for tile in tiles),
        y_min_m=min(tile.y_min_m for tile in tiles),
        x_max_m=max(tile.x_max_m for tile in tiles),
        y_max_m=max(tile.y_max_m for tile in tiles),
    )


def _add_plate(part: ET.Element, patch: GripPatch, height_m: float) -> None:
    """Add a thin box, because a plane is infinite in Gazebo."""
    x_m, y_m = (patch.x_min_m + patch.x_max_m) / 2.0, (patch.y_min_m + patch.y_max_m) / 2.0
    _add_text(part, "pose", (x_m, y_m, height_m, 0.0, 0.0, 0.0))
    box = ET.SubElement(ET.SubElement(part, "geometry"), "box")
    _add_text(box, "size", (patch.x_max_m - patch.x_min_m, patch.y_max_m - patch.y_min_m, LAYER_M))
    _add_text(part, qualify_tag("surface"), "soil")


def _add_rectangle(part: ET.Element, tile: GroundTile, height_m: float) -> None:
    x_m, y_m = (tile.x_min_m + tile.x_max_m) / 2.0, (tile.y_min_m + tile.y_max_m) / 2.0
    _add_text(part, "pose", (x_m, y_m, height_m, 0.0, 0.0, 0.0))
    plane = ET.SubElement(ET.SubElement(part, "geometry"), "plane")
    _add_text(plane, "normal", "0 0 1")
    _add_text(plane, "size", (tile.x_max_m - tile.x_min_m, tile.y_max_m - tile.y_min_m))


def _add_height_map(part: ET.Element, land: HeightField, file: str) -> None:
    rows, columns = land.height_m.shape
    size = ((columns - 1) * land.resolution_m, (rows - 1) * land.resolution_m)
    middle = (land.x_min_m + size[0] / 2.0, land.y_min_m + size[1] / 2.0, 0.0)
    shape = ET.SubElement(ET.SubElement(part, "geometry"), "heightmap")
    _add_text(shape, "uri", file)
    _add_text(shape, "size", (*size, max(float(np.ptp(land.height_m)), 1e-3)))
    _add_text(shape, "pos", middle)


def _add_obstacle(top: ET.Element, obstacle: Obstacle, names: set[str]) -> None:
    """Add a model for an obstacle; one that is only visible has the name of its solid part."""
    name = obstacle.name.removesuffix("/visual") if not obstacle.collides else obstacle.name
    own = name if name not in names else f"{name}_seen"
    names.add(own)
    model = ET.SubElement(top, "model", {"name": own})
    _add_text(model, "static", "true")
    at = (obstacle.x_map_m, obstacle.y_map_m, obstacle.z_map_m)
    _add_text(model, "pose", (*at, 0.0, 0.0, obstacle.yaw_rad))
    _add_text(model, qualify_tag("kind"), obstacle.kind)
    link = ET.SubElement(model, "link", {"name": "link"})
    for index, shape in enumerate(obstacle.shapes):
        for part in ("collision", "visual") if obstacle.collides else ("visual",):
            _add_shape(ET.SubElement(link, part, {"name": f"{part}_{index}"}), shape, part)


def _add_walker(top: ET.Element, walker: Walker) -> None:
    """Add an actor; other simulators show it with the skin of their own library."""
    actor = ET.SubElement(top, "actor", {"name": walker.name})
    _add_text(actor, qualify_tag("kind"), walker.kind)
    _add_text(ET.SubElement(actor, "skin"), "filename", SKIN)
    _add_text(ET.SubElement(actor, "animation", {"name": "walk"}), "filename", SKIN)
    script = ET.SubElement(actor, "script")
    _add_text(script, "loop", str(walker.loops).lower())
    _add_text(script, "delay_start", (walker.delay_s,))
    _add_text(script, "auto_start", "true")
    way = ET.SubElement(script, "trajectory", {"id": "0", "type": "walk"})
    for point in walker.waypoints:
        place = ET.SubElement(way, "waypoint")
        _add_text(place, "time", (point.t_s,))
        _add_text(place, "pose", (point.x_map_m, point.y_map_m, 0.0, 0.0, 0.0, point.yaw_rad))


def _add_shape(part: ET.Element, shape: Shape, kind: str) -> None:
    _add_text(part, "pose", (*shape.origin.xyz_m, *shape.origin.rpy_rad))
    form = ET.SubElement(ET.SubElement(part, "geometry"), shape.kind)
    if shape.kind == "box":
        _add_text(form, "size", shape.size_m)
    else:
        _add_text(form, "radius", shape.size_m[:1])
        if shape.kind == "cylinder":
            _add_text(form, "length", shape.size_m[1:2])
    if kind == "visual":
        material = ET.SubElement(part, "material")
        _add_text(material, "ambient", shape.rgba)
        _add_text(material, "diffuse", shape.rgba)


def _add_plant(top: ET.Element, plant: Plant) -> None:
    ET.SubElement(
        top,
        qualify_tag("plant"),
        {
            "class": plant.plant.name.lower(),
            "species": plant.species,
            "x": repr(plant.x_map_m),
            "y": repr(plant.y_map_m),
            "yaw": repr(plant.yaw_rad),
            "height_m": repr(plant.size_m),
            "stem_radius_m": repr(plant.stem_radius_m),
            "seed": str(plant.seed),
        },
    )
