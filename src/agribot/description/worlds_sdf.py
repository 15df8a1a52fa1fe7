"""Worlds: from a name or an SDF file to a WorldSpec in the map frame."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import msgspec
import numpy as np

from agribot.core.config import RunConfig
from agribot.core.errors import DescriptionError
from agribot.core.geo import Datum
from agribot.core.messages import FloatArray, PlantClass
from agribot.core.robot import Shape
from agribot.core.world import HeightField, Obstacle, Plant, WorldSpec
from agribot.description.elements import FileFinding, SourceFile
from agribot.description.field_plants import replace_weeds
from agribot.description.markup import find_place, read_xml
from agribot.description.mesh_ground import (
    GroundMesh,
    choose_ground_mesh,
    make_height_field,
    transform_points,
)
from agribot.description.package import find_packaged_or_file, list_world_files
from agribot.description.plant_names import MOST_SIDE_M, NamedPlant, find_plant_name
from agribot.description.poses import extract_yaw, make_yaw_rotation, to_origin
from agribot.description.row_table import fit_row_table, list_crop_m, read_row_table
from agribot.description.scatter import (
    Crop,
    grow_named_weeds,
    grow_plants,
    read_crop,
    read_plants,
    read_weed_areas,
)
from agribot.description.sdf_actors import read_walkers
from agribot.description.sdf_header import Header
from agribot.description.sdf_library import ModelLibrary, is_crop_with_weed
from agribot.description.sdf_models import HeightMap, ModelParts, Patch, measure_side_m, read_parts
from agribot.description.sdf_placing import GROUND_M, PlacedModel, WorldModels, is_ground, is_robot
from agribot.description.surfaces import Surfaces
from agribot.description.terrain import load_heights, make_volcano, place_heights
from agribot.description.unread_world import warn_of_unread_parts, warn_of_unread_systems

START_M = 3.0  # distance of the start from the first plant, in a world that states no start
STEM_M = 0.02  # radius of the stem of a plant that only a name speaks of
CLEAR_M = 2.0  # distance of the robot's start from the middle of a box in an absent model's place


def list_worlds() -> list[str]:
    return sorted(list_world_files())


def load_world(
    name_or_path: str, *, seed: int = 0, weed_density_per_m2: float | None = None
) -> WorldSpec:
    """Read a packaged world or a .world or .sdf file, and grow its plants.

    The same file, seed and density give the same plants. Harmless problems of the file (repeated
    names, absent models or meshes) are in `warnings`.

    Raises: DescriptionError: unknown name, broken file, or a world without ground.
    """
    path = _find_world_file(name_or_path)
    return _WorldReader(path, SourceFile(path.name)).read(seed, weed_density_per_m2)


def load_run_world(config: RunConfig) -> WorldSpec:
    """Load the world of the settings, at their datum where it states no place or `--origin` did."""
    density_per_m2 = config.sim.weed_density_per_m2
    world = load_world(config.world, seed=config.seed, weed_density_per_m2=density_per_m2)
    if world.is_placed and not config.field.datum_source:
        return world
    return msgspec.structs.replace(world, datum=config.field.datum)


def load_place(name_or_path: str) -> Datum | None:
    """Read where on Earth a world is; None where its file does not say.

    Raises: DescriptionError: unknown name, or a broken file.
    """
    path = _find_world_file(name_or_path)
    return _WorldReader(path, SourceFile(path.name)).place


def check_world(name_or_path: str) -> tuple[FileFinding, ...]:
    """List all errors and problems of a world file, in the order of its lines.

    Raises: DescriptionError: unknown name, or no such file.
    """
    path = _find_world_file(name_or_path)
    source = SourceFile(path.name, collecting=True)
    if not path.is_file():
        raise DescriptionError(f"{path} does not exist; check the path")
    try:
        _WorldReader(path, source).read(0, None)
    except DescriptionError as error:
        source.note(error)
    return tuple(sorted(dict.fromkeys(source.findings), key=lambda f: (f.file, f.line)))


def _find_world_file(name_or_path: str) -> Path:
    return find_packaged_or_file("world", name_or_path, list_world_files(), (".world", ".sdf"))


class _WorldReader:
    """Collects the parts of one file."""

    def __init__(self, path: Path, source: SourceFile) -> None:
        self._source = source
        self._library = ModelLibrary(path)
        root = read_xml(path)
        world = root.find("world")
        if world is None:
            has = ", ".join(f"<{inner.tag}>" for inner in root) or "nothing"
            raise self._source.fail("SDF", f"there is no <world>; the file has {has}")
        self._world = world
        self._header = Header(world, self._source)
        self._map_from_world = self._header.map_from_world
        self._crops: list[Crop] = []
        self._obstacles: list[Obstacle] = []
        self._patches: list[tuple[FloatArray, Patch]] = []
        self._reliefs: list[tuple[FloatArray, HeightMap]] = []
        self._stand_ins: set[str] = set()
        self._taken: list[tuple[PlacedModel, ModelParts]] = []
        self._weeds: list[tuple[float, float, NamedPlant]] = []

    @property
    def place(self) -> Datum | None:
        return self._header.datum if self._header.is_placed else None

    def read(self, seed: int, weed_density_per_m2: float | None) -> WorldSpec:
        placing = WorldModels(self._world, self._source, self._library, self._map_from_world)
        spawn = placing.find_spawn()
        for model in placing.list_models():
            if is_robot(model.element):
                spawn = model.map_from_model if spawn is None else spawn
                self._source.warn(
                    f"the robot '{model.name}' of the world is left out; the one of --robot drives",
                    model.element,
                )
                continue
            with self._source.attempt(model.element):
                self._take_model(model)
        warn_of_unread_systems(self._world, self._source)
        areas = read_weed_areas(self._world, self._source)
        plants = grow_plants(self._crops, areas, self._map_from_world, seed, weed_density_per_m2)
        plants += read_plants(self._world, self._map_from_world, self._source)
        plants += grow_named_weeds(self._weeds, seed)
        if weed_density_per_m2 is not None and not areas:
            plants = replace_weeds(plants, weed_density_per_m2, seed)
        where = self._find_start(plants) if spawn is None else spawn
        terrain = self._read_terrain() or self._find_mesh_ground()
        self._obstacles += [o for taken in self._taken for o in _make_obstacles(*taken)]
        self._clear_start(float(where[0, 3]), float(where[1, 3]))
        surfaces = Surfaces(self._patches, self._reliefs, terrain, self._source)
        friction_ratio, grip = surfaces.find_friction()
        return WorldSpec(
            name=self._world.get("name", ""),
            datum=self._header.datum,
            is_placed=self._header.is_placed,
            rows=read_row_table(self._world, self._map_from_world, self._source),
            spawn_xy_map_m=(float(where[0, 3]), float(where[1, 3])),
            spawn_yaw_map_rad=extract_yaw(where),
            gravity_mps2=self._header.gravity_mps2,
            field_enu_t=self._header.field_enu_t,
            friction_ratio=friction_ratio,
            grip=grip,
            light=self._header.light,
            ground=surfaces.list_tiles(),
            soil=self._header.soil,
            strength=self._header.strength,
            relief=self._header.relief,
            terrain=terrain,
            plants=plants,
            obstacles=tuple(self._obstacles),
            walkers=read_walkers(self._world, self._source, self._library, self._map_from_world),
            warnings=self._source.list_warnings(),
        )

    def _find_start(self, plants: Sequence[Plant]) -> FloatArray:
        """Return where a robot starts that the world puts nowhere, (4, 4): before the first row."""
        x_m, y_m = self._map_from_world[:2, 3].tolist()
        rows = fit_row_table(list_crop_m(plants), (x_m, y_m))
        if rows is None:
            return np.eye(4)
        start = make_yaw_rotation(math.radians(rows.row_yaw_deg))
        start[:2, 3] = np.array(rows.first_row_start_map_m) - START_M * start[:2, 0]
        return start

    def _take_model(self, model: PlacedModel) -> None:
        """Take a model: a crop, or obstacles and the ground they contain."""
        crop = self._read_crop(model)
        if crop is not None:
            self._crops.append(crop)
            return
        if find_place(model.element)[1] == 0:
            self._stand_ins.add(model.name)
        warn_of_unread_parts(model.element, model.name, self._source)
        parts = read_parts(model.element, self._source, self._library)
        if self._take_named_plants(model, parts):
            return
        self._taken.append((model, parts))
        self._patches += [(model.map_from_model, patch) for patch in parts.patches]
        self._reliefs += [(model.map_from_model, relief) for relief in parts.reliefs]

    def _take_named_plants(self, model: PlacedModel, parts: ModelParts) -> bool:
        """Add the plants that a model's names mean; return whether the model is a single plant."""
        plants, is_whole = parts.plants, False
        name = find_plant_name(model.kind) or find_plant_name(model.name)
        is_small = measure_side_m(parts.shapes) <= MOST_SIDE_M and not parts.has_ground
        if not plants and name is not None and is_small:
            plants, is_whole = (NamedPlant(name, (0.0, 0.0), name.height_m),), True
        for plant in plants:
            x_m, y_m = (model.map_from_model @ np.array([*plant.xy_m, 0.0, 1.0]))[:2].tolist()
            self._source.warn(
                f"models and meshes with '{plant.name.word}' in their names are taken for "
                f"{plant.name.plant.name.lower()} plants, drawn as {plant.name.species}"
            )
            if plant.name.plant is PlantClass.WEED:
                self._weeds.append((x_m, y_m, plant))
            else:
                species = plant.name.species
                self._crops.append(Crop(x_m, y_m, species, plant.height_m, 0.0, STEM_M, None))
        return is_whole

    def _find_mesh_ground(self) -> HeightField | None:
        """Take a wide mesh as the ground of a world without any, level ground for a lost one."""
        if self._patches or self._reliefs:
            return None
        meshes = [
            GroundMesh(mesh, transform_points(model.map_from_model, mesh.corners_m), index)
            for index, (model, parts) in enumerate(self._taken)
            for mesh in parts.meshes
        ]
        chosen = choose_ground_mesh(meshes)
        lost = next((m for m in meshes if not len(m.corners_m) and is_ground(m.mesh.words)), None)
        if chosen is not None:
            field = make_height_field(chosen.corners_m)
            what = f"a grid of {field.resolution_m:.2g} m"
        elif lost is not None:
            chosen, field, what = lost, None, "level"
            patch = Patch("soil", np.eye(4), (GROUND_M, GROUND_M), False, 1.0)
            self._patches.append((self._taken[lost.model][0].map_from_model, patch))
        else:
            return None
        model, parts = self._taken[chosen.model]
        self._source.warn(f"mesh of '{model.name}' is the ground of this world, {what}")
        self._taken[chosen.model] = (model, parts.leave_out(chosen.mesh.box))
        return field

    def _clear_start(self, x_m: float, y_m: float) -> None:
        """Remove boxes in the place of absent models from where the robot starts."""
        for thing in [o for o in self._obstacles if o.name in self._stand_ins]:
            if max(abs(thing.x_map_m - x_m), abs(thing.y_map_m - y_m)) < CLEAR_M:
                self._obstacles.remove(thing)
                self._source.warn(f"'{thing.name}' would stand on the robot; it is left out")

    def _read_crop(self, model: PlacedModel) -> Crop | None:
        x_m, y_m = model.map_from_model[:2, 3].tolist()
        crop = read_crop(model.element, x_m, y_m, self._source)
        if crop is None and (is_crop_with_weed(model.kind) or is_crop_with_weed(model.name)):
            ours = self._library.find("model://crop_with_weed")
            crop = None if ours is None else read_crop(ours, x_m, y_m, self._source)
        return crop

    def _read_terrain(self) -> HeightField | None:
        """Read the first height map of the world, which is both solid and visible."""
        for frame, relief in self._reliefs:
            with self._source.attempt(relief.element):
                return self._read_height_field(frame, relief)
        return None

    def _read_height_field(self, frame: FloatArray, relief: HeightMap) -> HeightField:
        element, source = relief.element, self._source
        size = source.parse_vec3(element.findtext("size", "1 1 1"), "<heightmap> <size>")
        if min(size) <= 0.0:
            raise source.fail("<heightmap>", f"<size> is {size}; all three must be positive")
        uri = (element.findtext("uri") or "").strip()
        file = self._library.find_file(uri)
        if file is not None and file.suffix.lower() in {".png", ".npy", ".jpg", ".jpeg", ".tif"}:
            heights = load_heights(file)
            heights_m = heights if file.suffix == ".npy" else heights * size[2]
        else:
            source.warn(f"height map '{uri}' is not on this machine; a volcano stands in for it")
            heights_m = make_volcano(0, size_m=min(size[:2]), top_m=size[2])
        pos = np.eye(4)
        pos[:2, 3] = source.parse_vec3(element.findtext("pos", "0 0 0"), "<heightmap> <pos>")[:2]
        if file is not None:
            pos[2, 3] = source.parse_vec3(element.findtext("pos", "0 0 0"), "<heightmap> <pos>")[2]
        return place_heights(heights_m, (size[0], size[1]), frame @ relief.model_from_relief @ pos)


def _make_obstacles(model: PlacedModel, parts: ModelParts) -> list[Obstacle]:
    """Make obstacles of a model's solid part and, separately, of its only visible part."""
    yaw_rad = extract_yaw(model.map_from_model)
    tilt = make_yaw_rotation(-yaw_rad) @ model.map_from_model
    tilt[:3, 3] = 0.0
    upright = bool(np.allclose(tilt, np.eye(4), atol=1e-12))
    x_m, y_m, z_m = model.map_from_model[:3, 3].tolist()

    def select_shapes(collides: bool) -> tuple[Shape, ...]:
        chosen = [part.shape for part in parts.shapes if part.collides == collides]
        return tuple(shape if upright else _tilt_shape(shape, tilt) for shape in chosen)

    return [
        Obstacle(
            name=model.name if collides else f"{model.name}/visual",
            kind=model.kind,
            x_map_m=x_m,
            y_map_m=y_m,
            z_map_m=z_m,
            yaw_rad=yaw_rad,
            shapes=select_shapes(collides),
            collides=collides,
        )
        for collides in (True, False)
        if select_shapes(collides)
    ]


def _tilt_shape(shape: Shape, tilt: FloatArray) -> Shape:
    return Shape(
        kind=shape.kind,
        size_m=shape.size_m,
        origin=to_origin(tilt @ shape.origin.matrix()),
        mesh=shape.mesh,
        rgba=shape.rgba,
    )
