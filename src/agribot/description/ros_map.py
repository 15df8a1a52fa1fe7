"""Occupancy maps in the format of ROS's map_server: a YAML file and a picture.

They are geo-referenced: `datum` in the YAML is the place of the map's frame on Earth, which
map_server ignores.
"""

from __future__ import annotations

import math
import re
from pathlib import Path

import msgspec
import numpy as np
import numpy.typing as npt

from agribot.core.errors import DescriptionError, explain_os_error
from agribot.core.geo import Datum
from agribot.core.table_text import read_text_file
from agribot.core.world import Obstacle, WorldSpec
from agribot.description.pictures import read_grey

OCCUPIED, FREE, UNKNOWN = 100, 0, -1
BLACK, WHITE, GREY = 0, 254, 205  # levels of the picture, as map_saver writes them
MAX_CELLS = 10_000  # cells along one side

Cells = npt.NDArray[np.int8]


LIST_LINES = re.compile(r":[ \t]*\n((?:[ \t]*-[ \t]+\S+[ \t]*(?:\n|$))+)")
LIST_ITEM = re.compile(r"-[ \t]+(\S+)")


class RosMap(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """An occupancy map.

    `cells` (height, width) are OCCUPIED, FREE or UNKNOWN, rows from South to North. The lower
    left corner of the first cell lies at `x_min_m`, `y_min_m` in the map, about which the picture
    is turned by `yaw_rad`, counter-clockwise.
    """

    cells: Cells
    resolution_m: float
    x_min_m: float
    y_min_m: float
    occupied_ratio: float = 0.65
    free_ratio: float = 0.196
    datum: Datum | None = None
    yaw_rad: float = 0.0

    def read_cell(self, x_map_m: float, y_map_m: float) -> int:
        """Return the cell at a place; UNKNOWN outside the map."""
        cos, sin = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        east_m, north_m = x_map_m - self.x_min_m, y_map_m - self.y_min_m
        row = math.floor((cos * north_m - sin * east_m) / self.resolution_m)
        column = math.floor((cos * east_m + sin * north_m) / self.resolution_m)
        rows, columns = self.cells.shape
        inside = 0 <= row < rows and 0 <= column < columns
        return int(self.cells[row, column]) if inside else UNKNOWN

    def count_cells(self) -> dict[str, int]:
        """Count the cells of each state."""
        states = {"occupied": OCCUPIED, "free": FREE, "unknown": UNKNOWN}
        return {name: int((self.cells == state).sum()) for name, state in states.items()}


def load_ros_map(path: Path) -> RosMap:
    """Read a map_server YAML file and the picture that it names.

    Raises: DescriptionError: a file or key is missing, or a value makes no sense.
    """
    keys = _read_keys(path)
    origin = _parse_numbers(keys, "origin", path)
    (resolution_m,) = _parse_numbers(keys, "resolution", path)
    if len(origin) != 3 or resolution_m <= 0.0:
        raise DescriptionError(
            f"{path.name}: origin {origin} and resolution {resolution_m:g}; write the origin as "
            "East, North and yaw, and a resolution above 0"
        )
    picture = path.parent / keys.get("image", "")
    if not picture.is_file():
        raise DescriptionError(
            f"{path.name}: image '{keys.get('image', '')}' cannot be read; copy it beside the map"
        )
    shades = read_grey(picture, MAX_CELLS)
    occupied, free = (_parse_numbers(keys, k, path)[0] for k in ("occupied_thresh", "free_thresh"))
    darkness = shades if _parse_numbers(keys, "negate", path)[0] else 1.0 - shades
    cells = np.full(shades.shape, UNKNOWN, dtype=np.int8)
    cells[darkness > occupied], cells[darkness < free] = OCCUPIED, FREE
    place = _parse_numbers(keys, "datum", path) if "datum" in keys else ()
    return RosMap(
        cells=cells,
        resolution_m=resolution_m,
        x_min_m=origin[0],
        y_min_m=origin[1],
        occupied_ratio=occupied,
        free_ratio=free,
        datum=Datum(lat_deg=place[0], lon_deg=place[1]) if len(place) >= 2 else None,
        yaw_rad=origin[2],
    )


def save_ros_map(ros_map: RosMap, path: Path) -> None:
    """Write the YAML file and a PNG of the same name.

    Raises: DescriptionError: a place that cannot be written.
    """
    from PIL import Image

    cells = ros_map.cells
    shades = np.full(cells.shape, GREY, dtype=np.uint8)
    shades[cells == OCCUPIED], shades[cells == FREE] = BLACK, WHITE
    lines = [
        f"image: {path.stem}.png",
        f"resolution: {ros_map.resolution_m!r}",
        f"origin: [{ros_map.x_min_m!r}, {ros_map.y_min_m!r}, {ros_map.yaw_rad!r}]",
        "negate: 0",
        f"occupied_thresh: {ros_map.occupied_ratio!r}",
        f"free_thresh: {ros_map.free_ratio!r}",
    ]
    if ros_map.datum is not None:
        lines.append(f"datum: [{ros_map.datum.lat_deg!r}, {ros_map.datum.lon_deg!r}]")
    with explain_os_error(f"cannot write {path}", "choose another", DescriptionError):
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
        Image.fromarray(np.ascontiguousarray(np.flipud(shades))).save(path.with_suffix(".png"))


def make_world_map(world: WorldSpec, size_m: float = 20.0, resolution_m: float = 0.1) -> RosMap:
    """Make a square map about the datum: occupied by a world's solid obstacles, else free.

    Raises: DescriptionError: no cell, or more than MAX_CELLS along a side.
    """
    count, min_m = round(size_m / resolution_m), -size_m / 2.0
    if not 1 <= count <= MAX_CELLS:
        raise DescriptionError(
            f"a map of {size_m:g} m with cells of {resolution_m:g} m has {count} cells along a "
            f"side; choose size and resolution for 1 to {MAX_CELLS}"
        )
    middle_m = min_m + (np.arange(count) + 0.5) * resolution_m
    x, y = np.meshgrid(middle_m, middle_m)
    cells = np.zeros((count, count), dtype=np.int8)
    for obstacle in world.obstacles:
        if obstacle.collides:
            cells[_find_covered(obstacle, x, y, resolution_m / 2.0)] = OCCUPIED
    return RosMap(
        cells=cells, resolution_m=resolution_m, x_min_m=min_m, y_min_m=min_m, datum=world.datum
    )


def _find_covered(
    obstacle: Obstacle, x: npt.NDArray[np.float64], y: npt.NDArray[np.float64], reach_m: float
) -> npt.NDArray[np.bool_]:
    """Return the cells (height, width) that the boxes of an obstacle's shapes touch in plan view.

    `x` and `y` (height, width) are the middles of the cells.
    """
    cos, sin = math.cos(obstacle.yaw_rad), math.sin(obstacle.yaw_rad)
    along = (x - obstacle.x_map_m) * cos + (y - obstacle.y_map_m) * sin
    across = (y - obstacle.y_map_m) * cos - (x - obstacle.x_map_m) * sin
    covered = np.zeros(x.shape, dtype=bool)
    for shape in obstacle.shapes:
        pose = shape.origin.matrix()
        a, b, c = shape.size_m
        half = {"box": (a / 2, b / 2, c / 2), "sphere": (a, a, a)}.get(shape.kind, (a, a, b / 2))
        reach = np.abs(pose[:2, :3]) @ np.array(half) + reach_m
        covered |= (np.abs(along - pose[0, 3]) <= reach[0]) & (
            np.abs(across - pose[1, 3]) <= reach[1]
        )
    return covered


def _read_keys(path: Path) -> dict[str, str]:
    """Read the flat `key: value` lines of the YAML that map_server reads."""
    try:
        text = read_text_file(path)
    except (OSError, ValueError) as error:
        raise DescriptionError(f"cannot read map {path}: {error}; check the path") from error
    text = LIST_LINES.sub(lambda found: f": [{','.join(LIST_ITEM.findall(found[1]))}]\n", text)
    pairs = re.findall(r"^(\w+)\s*:\s*(.*?)\s*(?:#.*)?$", text, flags=re.MULTILINE)
    return {key: value.strip("'\"") for key, value in pairs}


def _parse_numbers(keys: dict[str, str], key: str, path: Path) -> tuple[float, ...]:
    try:
        values = tuple(float(word) for word in keys[key].strip("[]").split(","))
    except KeyError as error:
        raise DescriptionError(
            f"{path.name}: '{key}' is missing; there are: {', '.join(keys) or 'none'}"
        ) from error
    except ValueError as error:
        raise DescriptionError(
            f"{path.name}: {key}: '{keys[key]}' is no number; write one"
        ) from error
    if not all(math.isfinite(value) for value in values):
        raise DescriptionError(f"{path.name}: {key}: '{keys[key]}' is not finite; write a number")
    return values
