"""Mapviz's multi-resolution images, a `.geo` file beside tiles, as a raster for GDAL.

Only the finest layer is used (`layer0/tile{row:05d}x{column:05d}.png` or .jpg); the coarser ones
follow from it. Format: https://swri-robotics.github.io/mapviz/plugins/
"""

from __future__ import annotations

import math
import re
from pathlib import Path
from xml.sax.saxutils import escape

import msgspec
import numpy as np
from PIL import Image

from agribot.core.errors import ConfigError
from agribot.core.messages import FloatArray
from agribot.core.table_text import read_text_file

SUFFIXES = (".png", ".jpg", ".jpeg")
MAX_TURN_DEG = 5.0
_NUMBERS = re.compile(r"\[([^\]]*)\]")


class TiledImage(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The finest layer of tiles and its place.

    `world_from_pixel` (2, 3) is affine: column and row from the upper left corner to east and
    north in the units of `srs`.
    """

    folder: Path
    width_px: int
    height_px: int
    tile_px: int
    srs: str
    world_from_pixel: FloatArray


def read_geo(path: Path) -> TiledImage:
    """Read a `.geo` file.

    Raises: ConfigError: not such a file, or one without the place of the picture.
    """
    try:
        text = re.sub(r"(//|#).*", "", read_text_file(path))
    except ValueError as error:
        raise ConfigError(
            f"{path.name} is no .geo file of mapviz: {error}; give another"
        ) from error
    lines = re.findall(r"(?m)^(\w+):[ \t]*(.*?)\s*$", text)
    keys = {key: value.strip(" \"'") for key, value in lines}
    try:
        sizes = [int(keys[f"image_{side}"]) for side in ("width", "height")]
        tile_px = int(keys["tile_size"])
    except (KeyError, ValueError) as error:
        raise ConfigError(
            f"{path.name} is no .geo file of mapviz: it needs image_width, image_height "
            "and tile_size; add them"
        ) from error
    if min(*sizes, tile_px) <= 0:
        raise ConfigError(
            f"{path.name}: sizes {sizes} and tile_size {tile_px}; all must be above 0"
        )
    return TiledImage(
        folder=path.parent / keys.get("image_path", "."),
        width_px=sizes[0],
        height_px=sizes[1],
        tile_px=tile_px,
        srs=_find_srs(keys, path.name),
        world_from_pixel=_fit_affine(text, keys, path.name),
    )


def _find_srs(keys: dict[str, str], name: str) -> str:
    projection = keys.get("projection", "")
    if projection in {"geographic", "wgs84"}:
        return "EPSG:4326"
    if projection != "utm":
        raise ConfigError(f"{name}: projection '{projection}'; use geographic, wgs84 or utm")
    zone = re.fullmatch(r"(\d{1,2})([NS])", keys.get("zone", "").upper())
    if zone is None or not 1 <= int(zone[1]) <= 60:
        raise ConfigError(f"{name} does not say its UTM zone; add a line such as 'zone: 43N'")
    return f"EPSG:{(32600 if zone[2] == 'N' else 32700) + int(zone[1])}"


def _fit_affine(text: str, keys: dict[str, str], name: str) -> FloatArray:
    """Fit an affine map (2, 3) to the tie points."""
    ties = _read_tie_points(text, keys, name)
    pixels, places = ties[:, :2], ties[:, 2:]
    if len(ties) >= 3:
        columns = np.column_stack([pixels, np.ones(len(ties))])
        solved, _, rank, _ = np.linalg.lstsq(columns, places, rcond=None)
        if rank < 3:
            raise ConfigError(f"{name}: the tie points lie on one line; give a third beside it")
        affine: FloatArray = np.asarray(solved.T, dtype=np.float64)
    else:
        step = _read_pixel_scale(ties, keys, name)
        affine = np.array([[step[0], 0.0, 0.0], [0.0, -step[1], 0.0]])
        affine[:, 2] = places[0] - affine[:, :2] @ pixels[0]
    turn_deg = abs(math.degrees(math.atan2(affine[1, 0], affine[0, 0])))
    if turn_deg > MAX_TURN_DEG or affine[1, 1] >= 0.0:
        raise ConfigError(
            f"{name}: the picture is turned by {turn_deg:.0f} degrees or upside down; turn it "
            "north up with gdalwarp first"
        )
    return affine


def _read_tie_points(text: str, keys: dict[str, str], name: str) -> FloatArray:
    """Read the tie points (n, 4): pixel x, pixel y, geo x, geo y.

    A single `tiepoint` of degrees has latitude first, as in mapviz's own example.
    """
    rows = re.findall(r"point:\s*\[([^\]]*)\]", text)
    try:
        ties = np.array([[float(number) for number in row.split(",")] for row in rows])
    except ValueError as error:
        raise ConfigError(
            f"{name}: a tie point is no list of four numbers; write X, Y, EAST, NORTH"
        ) from error
    if ties.ndim != 2 or ties.shape[1] != 4 or not np.isfinite(ties).all():
        raise ConfigError(
            f"{name} has no tie points of four numbers; write where it lies: X, Y, EAST, NORTH"
        )
    if "tiepoint" in keys and _find_srs(keys, name) == "EPSG:4326":
        ties[:, 2:] = ties[:, :1:-1]
    return ties


def _read_pixel_scale(ties: FloatArray, keys: dict[str, str], name: str) -> FloatArray:
    found = _NUMBERS.search(keys.get("pixel_scale", ""))
    if found:
        try:
            step = np.array([float(number) for number in found[1].split(",")])
        except ValueError as error:
            raise ConfigError(
                f"{name}: pixel_scale [{found[1]}] is no list of numbers; "
                "write two, such as 0.1, 0.1"
            ) from error
    elif len(ties) == 2 and (ties[0, :2] != ties[1, :2]).all():
        moved = ties[1] - ties[0]
        step = np.array([moved[2] / moved[0], -moved[3] / moved[1]])
    else:
        raise ConfigError(f"{name}: one tie point needs a pixel_scale beside it; add it")
    if step.shape != (2,) or not (step > 0.0).all():
        raise ConfigError(f"{name}: pixel_scale {step.tolist()}; give two numbers above 0")
    return step


def write_vrt(pyramid: TiledImage, path: Path) -> None:
    """Write all tiles of the finest layer as one picture, in GDAL's virtual format.

    Raises: ConfigError: a tile is missing or no picture.
    """
    a = pyramid.world_from_pixel
    order = (a[0, 2], a[0, 0], a[0, 1], a[1, 2], a[1, 0], a[1, 1])
    tiles = [
        (_find_tile(pyramid, row, column), row, column) for row, column in _list_addresses(pyramid)
    ]
    bands = "".join(
        f'<VRTRasterBand dataType="Byte" band="{band}"><ColorInterp>{name}</ColorInterp>'
        + "".join(_format_source(pyramid, *tile, band) for tile in tiles)
        + "</VRTRasterBand>"
        for band, name in enumerate(("Red", "Green", "Blue"), start=1)
    )
    path.write_text(
        f'<VRTDataset rasterXSize="{pyramid.width_px}" rasterYSize="{pyramid.height_px}">'
        f'<SRS dataAxisToSRSAxisMapping="{"2,1" if pyramid.srs == "EPSG:4326" else "1,2"}">'
        f"{pyramid.srs}</SRS>"
        f"<GeoTransform>{','.join(f'{value:.15g}' for value in order)}</GeoTransform>"
        f"{bands}</VRTDataset>",
        encoding="utf-8",
    )


def _list_addresses(pyramid: TiledImage) -> list[tuple[int, int]]:
    rows, columns = (
        math.ceil(size / pyramid.tile_px) for size in (pyramid.height_px, pyramid.width_px)
    )
    return [(row, column) for row in range(rows) for column in range(columns)]


def _find_tile(pyramid: TiledImage, row: int, column: int) -> Path:
    stem = pyramid.folder / "layer0" / f"tile{row:05d}x{column:05d}"
    found = [stem.with_suffix(suffix) for suffix in SUFFIXES if stem.with_suffix(suffix).is_file()]
    if not found:
        raise ConfigError(
            f"the tile {stem}.png (or .jpg) is missing; copy all tiles beside the file"
        )
    return found[0].resolve()


def _format_source(pyramid: TiledImage, tile: Path, row: int, column: int, band: int) -> str:
    left_px, top_px = column * pyramid.tile_px, row * pyramid.tile_px
    try:
        with Image.open(tile) as picture:
            width_px = min(picture.width, pyramid.width_px - left_px)
            height_px = min(picture.height, pyramid.height_px - top_px)
            bands = len(picture.getbands())
    except OSError as error:
        raise ConfigError(f"the tile {tile} is no picture: {error}; copy it anew") from error
    size = f'xSize="{width_px}" ySize="{height_px}"'
    return (
        f"<SimpleSource><SourceFilename>{escape(str(tile))}</SourceFilename>"
        f"<SourceBand>{band if bands >= 3 else 1}</SourceBand>"
        f'<SrcRect xOff="0" yOff="0" {size}/><DstRect xOff="{left_px}" yOff="{top_px}" {size}/>'
        "</SimpleSource>"
    )
