"""Maps of other formats as tiles of one file: GeoTIFF, PMTiles, tile servers."""

from __future__ import annotations

import io
import itertools
import math
import tempfile
import urllib.request
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from agribot.core.arithmetic import clamp
from agribot.core.errors import ConfigError
from agribot.gis.geo_pyramid import read_geo, write_vrt
from agribot.gis.mbtiles import LIVE, MAX_ZOOM, TileWriter, is_picture
from agribot.gis.tile_grid import HALF_M, TILE_PX, Bounds, Tile, tile_count, tiles_in

if TYPE_CHECKING:
    import rasterio

WEB, DEGREES = "EPSG:3857", "EPSG:4326"
MAX_TILES = 200_000
OVERVIEW_TILES = 4  # the coarsest zoom shows the whole picture on about so many
PARALLEL = 6
TIMEOUT_S = 20.0
MAX_TILE_BYTES = 2_000_000
WEBP_QUALITY = 85
AGENT = "agribot (offline maps of a field robot)"

Report = Callable[[int, int], None]  # tiles done, tiles in all


def import_geotiff(source: Path, target: Path, report: Report) -> None:
    """Any raster that GDAL reads and that says where it lies, turned to the grid of web tiles.

    Raises: ConfigError: not readable, without a place, or larger than makes sense here.
    """
    rasterio = _rasterio()
    from rasterio.warp import calculate_default_transform, transform_bounds

    try:
        with warnings.catch_warnings(action="ignore"), rasterio.open(source) as raster:
            if raster.crs is None:
                raise ConfigError(
                    f"{source.name} does not say where it lies (no coordinate system); give it one "
                    "with gdal_edit.py -a_srs, or export it as GeoTIFF"
                )
            bounds = Bounds(*transform_bounds(raster.crs, DEGREES, *raster.bounds))
            size = raster.width, raster.height
            fine, _, _ = calculate_default_transform(raster.crs, WEB, *size, *raster.bounds)
            last = _zoom_of(fine.a)
            first = _first_zoom(bounds, last)
            count = _checked_count(bounds, first, last)
            with TileWriter(target, _metadata(target, bounds, first, last, "webp")) as writer:
                for done, tile in enumerate(tiles_in(bounds, first, last), start=1):
                    data = _drawn(raster, tile)
                    if data:
                        writer.put(*tile, data)
                    report(done, count)
    except rasterio.errors.RasterioError as error:
        raise ConfigError(f"cannot read {source} as a raster: {error}") from error


def _drawn(raster: rasterio.DatasetReader, tile: Tile) -> bytes:
    """One tile as WebP; nothing where the picture has nothing."""
    from PIL import Image
    from rasterio.enums import Resampling
    from rasterio.transform import from_bounds
    from rasterio.vrt import WarpedVRT

    grid = {"transform": from_bounds(*tile.edges_m(), TILE_PX, TILE_PX),
            "width": TILE_PX, "height": TILE_PX}  # fmt: skip
    with WarpedVRT(
        raster, crs=WEB, resampling=Resampling.bilinear, add_alpha=True, **grid
    ) as picture:
        bands = picture.read()
    alpha = bands[-1]
    if not alpha.any():
        return b""
    colours = bands[:3] if len(bands) >= 4 else np.repeat(bands[:1], 3, axis=0)
    rgba = np.moveaxis(np.concatenate([_bytes(colours), _bytes(alpha[None])]), 0, 2)
    buffer = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(rgba), "RGBA").save(buffer, "WEBP", quality=WEBP_QUALITY)
    return buffer.getvalue()


def _bytes(bands: Any) -> Any:
    """Pixels of 16 bits and of floating point numbers as bytes, by the range of their type."""
    if bands.dtype == np.uint8:
        return bands
    top = float(np.iinfo(bands.dtype).max) if bands.dtype.kind in "ui" else 1.0
    return np.clip(bands / top * 255.0, 0.0, 255.0).astype(np.uint8)


def import_geo(source: Path, target: Path, report: Report) -> None:
    """Mapviz's multi-resolution image.

    Raises: ConfigError: not such a file, a tile is missing, or it is turned.
    """
    with tempfile.TemporaryDirectory() as folder:
        picture = Path(folder) / f"{source.stem}.vrt"
        write_vrt(read_geo(source), picture)
        import_geotiff(picture, target, report)


def import_pmtiles(source: Path, target: Path, report: Report) -> None:
    """Raises: ConfigError: no PMTiles archive, or one of vector tiles."""
    try:
        from pmtiles.reader import MmapSource, Reader, all_tiles
    except ImportError as error:
        raise _missing("pmtiles") from error
    if not source.is_file():
        raise ConfigError(f"map file {source} does not exist; check the path")
    with source.open("rb") as file:
        try:
            get_bytes = MmapSource(file)  # an empty file cannot be mapped
            header = Reader(get_bytes).header()
            tiles: Iterator[tuple[tuple[int, int, int], bytes]] = all_tiles(get_bytes)
            first = next(tiles, None)
        except Exception as error:  # the library's own errors have no common base
            raise ConfigError(f"{source.name} is no PMTiles archive: {error}") from error
        if first is None or not is_picture(first[1]):
            raise ConfigError(f"{source.name} holds no raster tiles (PNG, JPEG or WebP)")
        degrees = (
            header[f"{edge}_e7"] / 1e7 for edge in ("min_lon", "min_lat", "max_lon", "max_lat")
        )
        low, high = header["min_zoom"], header["max_zoom"]
        count = header.get("addressed_tiles_count") or 0
        metadata = _metadata(target, Bounds(*degrees), low, high, "")
        with TileWriter(target, metadata) as writer:
            for done, (address, data) in enumerate(itertools.chain([first], tiles), start=1):
                writer.put(*address, data)
                report(done, max(count, done))


def import_from_server(
    template: str, target: Path, bounds: Bounds, zooms: tuple[int, int], attribution: str,
    report: Report,
) -> None:  # fmt: skip
    """Fetch a region once; tiles that are there already are not asked for again.

    Raises: ConfigError: no template, too many tiles, or the server does not give any.
    """
    check_template(template)
    count, fetched, problem = _checked_count(bounds, *zooms), 0, ""
    metadata = {**_metadata(target, bounds, *zooms, ""), "attribution": attribution}
    with TileWriter(target, metadata) as writer, ThreadPoolExecutor(PARALLEL) as pool:
        missing = (tile for tile in tiles_in(bounds, *zooms) if not writer.has(*tile))
        done = count - sum(not writer.has(*tile) for tile in tiles_in(bounds, *zooms))
        while batch := list(itertools.islice(missing, PARALLEL * 4)):
            for tile, answer in zip(batch, pool.map(lambda t: _tried(template, t), batch),
                                    strict=True):  # fmt: skip
                done += 1
                if isinstance(answer, bytes):
                    writer.put(*tile, answer)
                    fetched += 1
                else:
                    problem = answer
                report(done, count)
    if problem and not fetched:
        raise ConfigError(f"no tile came from {template}: {problem}")


def register_server(template: str, target: Path, zooms: tuple[int, int], attribution: str) -> None:
    """A map whose tiles are fetched when somebody looks at them, and kept from then on."""
    check_template(template)
    world = Bounds(-180.0, -85.0, 180.0, 85.0)
    metadata = {**_metadata(target, world, *zooms, ""), "attribution": attribution, LIVE: template}
    with TileWriter(target, metadata):
        pass


def fetched_tile(template: str, tile: Tile) -> bytes:
    """Raises: OSError: no answer. ValueError: the answer is no picture of a sensible size."""
    url = template.format(z=tile.z, x=tile.x, y=tile.y)
    request = urllib.request.Request(url, headers={"User-Agent": AGENT})
    with urllib.request.urlopen(request, timeout=TIMEOUT_S) as answer:
        data: bytes = answer.read(MAX_TILE_BYTES + 1)
    if len(data) > MAX_TILE_BYTES or not is_picture(data):
        raise ValueError(f"{url} gave {len(data)} bytes that are no picture of a tile")
    return data


def check_template(template: str) -> None:
    """Raises: ConfigError: not an address of a tile server."""
    try:
        filled = template.format(z=1, x=1, y=0)
    except (KeyError, IndexError, ValueError):
        filled = ""
    is_filled = all(template.count(f"{{{name}}}") == 1 for name in "zxy")
    if not filled.startswith(("http://", "https://")) or not is_filled:
        raise ConfigError(
            f"{template} is no address of a tile server; write it as in "
            "https://tiles.example/{z}/{x}/{y}.png"
        )


def _tried(template: str, tile: Tile) -> bytes | str:
    try:
        return fetched_tile(template, tile)
    except (OSError, ValueError) as error:
        return str(error)


def _zoom_of(pixel_m: float) -> int:
    """The zoom whose pixels are at least as fine as the picture's."""
    zoom = math.ceil(math.log2(2.0 * HALF_M / TILE_PX / pixel_m) - 0.01)
    return clamp(zoom, 0, MAX_ZOOM)


def _first_zoom(bounds: Bounds, last: int) -> int:
    zoom = last
    while zoom > 0 and tile_count(bounds, zoom, zoom) > OVERVIEW_TILES:
        zoom -= 1
    return zoom


def _checked_count(bounds: Bounds, first: int, last: int) -> int:
    if not 0 <= first <= last <= MAX_ZOOM:
        raise ConfigError(f"zooms {first} to {last}: must be within 0 to {MAX_ZOOM}, in order")
    count = tile_count(bounds, first, last)
    if count > MAX_TILES:
        raise ConfigError(
            f"that would be {count} tiles, more than {MAX_TILES}; choose a smaller region or zoom"
        )
    return count


def _metadata(
    target: Path, bounds: Bounds, first: int, last: int, picture_format: str
) -> dict[str, str]:
    said = {"name": target.stem, "bounds": bounds.text(), "minzoom": str(first),
            "maxzoom": str(last), "type": "baselayer"}  # fmt: skip
    return {**said, "format": picture_format} if picture_format else said


def _rasterio() -> Any:
    try:
        import rasterio
        import rasterio.errors
    except ImportError as error:
        raise _missing("rasterio") from error
    return rasterio


def _missing(package: str) -> ConfigError:
    return ConfigError(f"this needs {package}; install it with pip install 'agribot[maps]'")
