"""Arrays of a world that the renderer draws: forms, instances and ground."""

from __future__ import annotations

from typing import Any, cast

import numpy as np

from agribot.core.errors import DescriptionError
from agribot.core.geo import transform
from agribot.core.messages import FloatArray, PlantClass
from agribot.core.robot import Shape
from agribot.core.world import GroundTile, HeightField, Obstacle, WorldSpec
from agribot.sim.camera.appearance import Appearance
from agribot.sim.camera.arrays import (
    Doubles,
    Forms,
    Ground,
    Instances,
    Longs,
    Singles,
    TexturePyramid,
    build_pyramid,
)
from agribot.sim.camera.ground import sample_height
from agribot.sim.camera.shadows import ShadowMap
from agribot.sim.camera.solids import build_shape_lods
from agribot.sim.camera.surfaces import EARTH, PERIOD_M, build_surface_texture, build_tone_map
from agribot.sim.flora.mesh import Mesh
from agribot.sim.flora.species import (
    LODS,
    SPECIES,
    build_plant_lods,
    find_nearest_stage,
    find_species,
)
from agribot.sim.flora.texture import build_leaf_atlas, make_tileable_noise
from agribot.sim.ground_surface import GroundSurface

PLAIN_LAYER = len(SPECIES)  # layer of the thing textures: an almost even grey that takes the tint
MAX_TILT_RAD = 0.10
FAR_EDGE_M = 1.0e9
TONE_PER_M = 8.0
# Contrast from one copy to the next: from afar the repeats of a texture would show.
FAR_CONTRAST = 0.85
GROUND_LEVELS, LEAF_LEVELS = 9, 7


def pack_forms(lods: list[tuple[Mesh, ...]]) -> Forms:
    """Pack the forms end to end, level by level."""
    meshes = [form[level] for level in range(LODS) for form in lods]
    vertices = [len(mesh.vertices_m) for mesh in meshes]
    faces = [len(mesh.faces) for mesh in meshes]
    columns = [np.column_stack([m.vertices_m, m.normals, m.uv, m.tone]) for m in meshes]
    columns.append(np.empty((0, 9), np.float32))  # a world may have nothing in it
    corners = [*(mesh.faces for mesh in meshes), np.empty((0, 3), np.int32)]
    return Forms(
        vertex=np.concatenate(columns),
        face=np.concatenate(corners),
        first_vertex=np.cumsum([0, *vertices])[:-1].astype(np.int64),
        vertices=np.array(vertices, np.int64),
        first_face=np.cumsum([0, *faces])[:-1].astype(np.int64),
        faces=np.array(faces, np.int64),
        radius=np.array(
            [np.linalg.norm(form[0].vertices_m, axis=1).max() for form in lods], np.float32
        ),
        forms=len(lods),
    )


def _hash_seeds(seeds: Longs, stream: int) -> FloatArray:
    """Hash the plants' seeds to even numbers in [0, 1), other ones for each stream."""
    offset = stream * 0xD1B54A32D192ED03 % 2**64
    state = seeds.astype(np.uint64) + np.uint64(offset)
    state = (state ^ (state >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    state = (state ^ (state >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return (state ^ (state >> np.uint64(31))) / 2.0**64


def make_plant_instances(
    world: WorldSpec, variants: int, look: Appearance, surface: GroundSurface | None = None
) -> tuple[Instances, list[tuple[Mesh, ...]]]:
    """Make an instance of each plant, in their order, and the forms that they use."""
    plants = world.plants
    keys = [(p.species, p.seed % variants, find_nearest_stage(p.species, p.size_m)) for p in plants]
    forms = {key: index for index, key in enumerate(dict.fromkeys(keys))}
    count = len(plants)
    seeds = np.array([p.seed % 2**63 for p in plants], np.int64)
    position = np.array([(p.x_map_m, p.y_map_m, 0.0) for p in plants]).reshape(count, 3)
    position[:, 2] = sample_ground_heights(world, position, surface)
    things = Instances(
        position=position,
        rotation=_make_leaning_rotations(np.array([p.yaw_rad for p in plants]), seeds),
        scale=np.array([p.size_m for p in plants], np.float32),
        form=np.array([forms[key] for key in keys], np.int64),
        tint=_make_tints(seeds, look),
        sun=np.ones(count, np.float32),
        layer=np.array([find_species(p.species).cell for p in plants], np.int64),
        label=np.array([int(p.plant) for p in plants], np.uint8),
        id=np.arange(count, dtype=np.int32),
        solid=np.zeros(count, np.uint8),
    )
    return things, [build_plant_lods(*key) for key in forms]


def _make_leaning_rotations(yaw_rad: FloatArray, seeds: Longs) -> Singles:
    """Make rotations (n, 3, 3) by the yaw (n,), then a little lean to one side."""
    count = len(seeds)
    lean_x = (_hash_seeds(seeds, 1) - 0.5) * 2 * MAX_TILT_RAD
    lean_y = (_hash_seeds(seeds, 2) - 0.5) * 2 * MAX_TILT_RAD
    cos, sin, zero, one = np.cos(yaw_rad), np.sin(yaw_rad), np.zeros(count), np.ones(count)
    turn = np.stack([cos, -sin, zero, sin, cos, zero, zero, zero, one], 1).reshape(-1, 3, 3)
    cx, sx, cy, sy = np.cos(lean_x), np.sin(lean_x), np.cos(lean_y), np.sin(lean_y)
    about_x = np.stack([one, zero, zero, zero, cx, -sx, zero, sx, cx], 1).reshape(-1, 3, 3)
    about_y = np.stack([cy, zero, sy, zero, one, zero, -sy, zero, cy], 1).reshape(-1, 3, 3)
    return np.ascontiguousarray(about_x @ about_y @ turn, np.float32)


def _make_tints(seeds: Longs, look: Appearance) -> Singles:
    """Make brightness and hue of each plant, (n, 3): some paler, some yellower, some bluer."""
    bright = 1.0 + 0.26 * (_hash_seeds(seeds, 3) - 0.5)
    yellow = look.hue_spread * 0.30 * (_hash_seeds(seeds, 4) - 0.5)
    blue = look.hue_spread * 0.36 * (_hash_seeds(seeds, 5) - 0.5)
    tint = np.stack([1.0 + yellow, 1.0 + 0.3 * yellow, 1.0 + blue], axis=1) * bright[:, None]
    return np.ascontiguousarray(tint * np.array(look.leaf_gain), np.float32)


def make_obstacle_instances(obstacles: tuple[Obstacle, ...], first_form: int) -> tuple[
    Instances, list[tuple[Mesh, ...]]
]:  # fmt: skip
    """Make an instance of each shape of each obstacle, and the forms, from `first_form` on."""
    pairs = [(thing, shape) for thing in obstacles for shape in thing.shapes]
    shapes = {(shape.kind, shape.size_m): shape for _thing, shape in pairs}
    forms = {key: form for form, key in enumerate(shapes, first_form)}
    count = len(pairs)
    poses = np.array([_make_pose(thing, shape) for thing, shape in pairs]).reshape(count, 4, 4)
    things = Instances(
        position=np.ascontiguousarray(poses[:, :3, 3]),
        rotation=np.ascontiguousarray(poses[:, :3, :3], np.float32),
        scale=np.ones(count, np.float32),
        form=np.array([forms[shape.kind, shape.size_m] for _thing, shape in pairs], np.int64),
        tint=np.array([shape.rgba[:3] for _thing, shape in pairs], np.float32).reshape(count, 3),
        sun=np.ones(count, np.float32),
        layer=np.full(count, PLAIN_LAYER, np.int64),
        label=np.full(count, int(PlantClass.SOIL), np.uint8),
        id=np.full(count, -1, np.int32),
        solid=np.ones(count, np.uint8),
    )
    return things, [build_shape_lods(shape) for shape in shapes.values()]


def _make_pose(thing: Obstacle, shape: Shape) -> FloatArray:
    at = (thing.x_map_m, thing.y_map_m, thing.z_map_m)
    return transform(at, (0.0, 0.0, thing.yaw_rad)) @ shape.origin.matrix()


def join_instances(first: Instances, second: Instances) -> Instances:
    parts = (np.concatenate(cast(Any, pair)) for pair in zip(first, second, strict=True))
    return Instances(*parts)


def sample_ground_heights(
    world: WorldSpec, position: FloatArray, surface: GroundSurface | None = None
) -> Doubles:
    """Return the height of the ground (n,) below positions (n, 3) of the map, m.

    A fine `surface` counts; else they are those of the world's terrain.
    """
    if surface is not None and surface.has_detail:
        return surface.sample_heights(position)
    terrain = world.terrain
    if terrain is None:
        return np.zeros(len(position))
    height = _read_terrain_heights(terrain)
    corner = (terrain.x_min_m, terrain.y_min_m, terrain.resolution_m)
    return np.array([sample_height(height, *corner, x, y) for x, y in position[:, :2].tolist()])


def build_leaf_textures(seed: int) -> TexturePyramid:
    atlas = build_leaf_atlas(seed)
    noise = make_tileable_noise(np.random.default_rng([seed, 3]), atlas.shape[1:3], exponent=0.8)
    plain = np.clip(205.0 * (1.0 + 0.08 * noise), 0.0, 255.0)[None, ..., None]
    plain = np.broadcast_to(plain, (1, *atlas.shape[1:]))
    return build_pyramid(np.concatenate([atlas, plain]).astype(np.float32), LEAF_LEVELS)


def _list_layers(tiles: tuple[GroundTile, ...]) -> list[str]:
    """List the surfaces of a world; soil is the first and lies outside the tiles."""
    return list(dict.fromkeys(["soil", *(tile.surface for tile in tiles)]))


def build_ground_textures(world: WorldSpec, to_sun: Doubles, look: Appearance) -> TexturePyramid:
    """Build the textures of the world's surfaces under a sun in direction `to_sun` (3,)."""
    images = []
    for surface in _list_layers(world.ground):
        relief = look.soil_contrast * min(1.0, world.light.diffuse / 0.75)
        image = build_surface_texture(
            surface, look.texture_seed, to_sun, relief, world.soil, look.flint_cover_ratio
        )
        if surface in EARTH:
            mean = image.mean(axis=(0, 1))
            image = (mean + (image - mean) * look.soil_contrast) * np.array(look.soil_tint)
        images.append(np.clip(image, 0.0, 255.0))
    return build_pyramid(np.stack(images).astype(np.float32), GROUND_LEVELS, FAR_CONTRAST)


def build_ground(world: WorldSpec, shadow: ShadowMap, look: Appearance) -> Ground:
    layers = _list_layers(world.ground)
    x_edge = _list_edges([(tile.x_min_m, tile.x_max_m) for tile in world.ground])
    y_edge = _list_edges([(tile.y_min_m, tile.y_max_m) for tile in world.ground])
    surface = np.zeros((len(y_edge) - 1, len(x_edge) - 1), np.uint8)
    for tile in world.ground:
        columns = slice(*np.searchsorted(x_edge, (tile.x_min_m, tile.x_max_m)))
        rows = slice(*np.searchsorted(y_edge, (tile.y_min_m, tile.y_max_m)))
        surface[rows, columns] = layers.index(tile.surface)
    terrain = world.terrain
    return Ground(
        x_edge=x_edge, y_edge=y_edge, surface=surface,
        repeat_per_m=1.0 / (PERIOD_M * look.soil_scale),
        tone=build_tone_map(look.texture_seed, world.soil.wet_ratio),
        tone_per_m=TONE_PER_M, height=_read_terrain_heights(terrain),
        height_x_m=terrain.x_min_m if terrain else 0.0,
        height_y_m=terrain.y_min_m if terrain else 0.0,
        height_step_m=terrain.resolution_m if terrain else 1.0,
        shade=shadow.shade, block=shadow.block, shade_x_m=shadow.x_m, shade_y_m=shadow.y_m,
        shade_step_m=shadow.step_m,
    )  # fmt: skip


def _list_edges(intervals: list[tuple[float, float]]) -> Doubles:
    edges = sorted({edge for interval in intervals for edge in interval})
    return np.array([-FAR_EDGE_M, *edges, FAR_EDGE_M])


def _read_terrain_heights(terrain: HeightField | None) -> Singles:
    if terrain is None:
        return np.empty((0, 0), np.float32)
    if min(terrain.height_m.shape) < 2:
        raise DescriptionError(
            f"the terrain has {terrain.height_m.shape} samples; it needs at least 2 x 2"
        )
    return np.ascontiguousarray(terrain.height_m, np.float32)
