"""Maps of other formats as tiles of one file: GeoTIFF, PMTiles, tile servers."""

from __future__ import annotations

import hashlib
import http.client
import io
import itertools
import math
import sqlite3
import tempfile
import urllib.error
import urllib.request
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from agribot.core.arithmetic import clamp
from agribot.core.errors import ConfigError
from agribot.core.extras import format_install
from agribot.gis.geo_pyramid import read_geo, write_vrt
from agribot.gis.mbtiles import (
    LIVE,
    MAX_ZOOM,
    SERVER,
    TileWriter,
    describe_map,
    is_picture,
    read_note,
)
from agribot.gis.tile_grid import HALF_M, TILE_PX, GeoBounds, MapTile, count_tiles, iterate_tiles

if TYPE_CHECKING:
    import rasterio

WEB, DEGREES = "EPSG:3857", "EPSG:4326"
MAX_TILES = 200_000
OVERVIEW_TILES = 4  # the coarsest zoom shows the whole picture on about this many
PARALLEL = 6
TIMEOUT_S = 20.0
MAX_TILE_BYTES = 2_000_000
WEBP_QUALITY = 85
AGENT = "agribot (offline maps of a field robot)"

NONE_THERE = (404, 410)  # answers of a server that has no tile at an address
Report = Callable[[int, int], None]  # tiles done, tiles in all


class MissingTiles(NamedTuple):
    """Tiles that did not come: `absent` the server has not, `failed` it may give another time.

    `why` is what the last failure said.
    """

    absent: int
    failed: int
    why: str


def import_geotiff(source: Path, target: Path, report: Report) -> None:
    """Import any georeferenced raster that GDAL reads, resampled to the grid of web tiles.

    Raises: ConfigError: not readable, without a place or a picture, or larger than MAX_TILES.
    """
    rasterio = _load_rasterio()
    try:
        with warnings.catch_warnings(action="ignore"), rasterio.open(source) as raster:
            bounds, pixel_m = _find_place(raster, source.name)
            last = _choose_zoom(pixel_m)
            first = _choose_first_zoom(bounds, last)
            count, drawn = _check_count(bounds, first, last), 0
            colours = _read_palette(raster)
            with TileWriter(target, _make_metadata(target, bounds, first, last, "webp")) as writer:
                for done, tile in enumerate(iterate_tiles(bounds, first, last), start=1):
                    data = _draw_tile(raster, tile, colours)
                    if data:
                        writer.put(*tile, data)
                        drawn += 1
                    report(done, count)
            if not drawn:
                raise ConfigError(
                    f"{source.name} has no picture that a map can show: every pixel is marked as "
                    "without data, or lies beyond 85 degrees North or South"
                )
    except rasterio.errors.RasterioError as error:
        raise ConfigError(f"cannot read {source} as a raster: {error}") from error


def _find_place(raster: rasterio.DatasetReader, name: str) -> tuple[GeoBounds, float]:
    """Find the bounds of a raster and the side of its pixels in Web Mercator, m.

    Raises: ConfigError: it does not say where it lies, or not on Earth.
    """
    from rasterio.warp import calculate_default_transform, transform_bounds

    if raster.crs is None:
        raise ConfigError(
            f"{name} does not say where it lies (no coordinate system); give it one "
            "with gdal_edit.py -a_srs, or export it as GeoTIFF"
        )
    try:
        bounds = GeoBounds(*transform_bounds(raster.crs, DEGREES, *raster.bounds))
        size = raster.width, raster.height
        fine, _, _ = calculate_default_transform(raster.crs, WEB, *size, *raster.bounds)
    except Exception as error:  # GDAL's errors have no common base
        raise ConfigError(
            f"{name} lies nowhere on Earth by its coordinate system "
            f"({raster.crs.to_string().partition(',')[0]}) and its edges "
            f"{', '.join(f'{edge:g}' for edge in raster.bounds)}; export it with the coordinate "
            "system that it is in"
        ) from error
    if not -180.0 <= bounds.west_deg < bounds.east_deg <= 180.0:
        raise ConfigError(
            f"{name} lies across the line of 180 degrees of longitude; cut it there into two "
            "pictures and import each"
        )
    return bounds, float(fine.a)


def _read_palette(raster: rasterio.DatasetReader) -> Any:
    """Read the colours (256, 4) of pixels that are numbers of colours; None of a real picture."""
    from rasterio.enums import ColorInterp

    if raster.colorinterp[0] != ColorInterp.palette or raster.dtypes[0] != "uint8":
        return None
    table = raster.colormap(1)
    return np.array([table.get(number, (0, 0, 0, 0)) for number in range(256)], dtype=np.uint8)


def _draw_tile(raster: rasterio.DatasetReader, tile: MapTile, palette: Any) -> bytes:
    """Draw a tile as WebP; empty bytes where the picture has no data."""
    from PIL import Image
    from rasterio.enums import ColorInterp, Resampling
    from rasterio.transform import from_bounds
    from rasterio.vrt import WarpedVRT

    grid = {"transform": from_bounds(*tile.compute_edges_m(), TILE_PX, TILE_PX),
            "width": TILE_PX, "height": TILE_PX}  # fmt: skip
    has_alpha = ColorInterp.alpha in raster.colorinterp
    resampling = Resampling.bilinear if palette is None else Resampling.nearest
    with WarpedVRT(
        raster, crs=WEB, resampling=resampling, add_alpha=not has_alpha, **grid
    ) as picture:
        bands = picture.read()
    at = raster.colorinterp.index(ColorInterp.alpha) if has_alpha else len(bands) - 1
    alpha, others = bands[at], np.delete(bands, at, axis=0)
    if not alpha.any():
        return b""
    if palette is not None:
        rgba = palette[others[0]]
        rgba[alpha == 0] = 0
    else:
        colours = others[:3] if len(others) >= 3 else np.repeat(others[:1], 3, axis=0)
        rgba = np.moveaxis(np.concatenate([_to_bytes(colours), _to_bytes(alpha[None])]), 0, 2)
    buffer = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(rgba), "RGBA").save(buffer, "WEBP", quality=WEBP_QUALITY)
    return buffer.getvalue()


def _to_bytes(bands: Any) -> Any:
    """Convert pixels of 16 bits and of floating point to bytes, by the range of their type."""
    if bands.dtype == np.uint8:
        return bands
    top = float(np.iinfo(bands.dtype).max) if bands.dtype.kind in "ui" else 1.0
    return np.clip(bands / top * 255.0, 0.0, 255.0).astype(np.uint8)


def import_geo(source: Path, target: Path, report: Report) -> None:
    """Import a multi-resolution image of mapviz.

    Raises: ConfigError: not such a file, a tile is missing, or it is turned.
    """
    with tempfile.TemporaryDirectory() as folder:
        picture = Path(folder) / f"{source.stem}.vrt"
        write_vrt(read_geo(source), picture)
        import_geotiff(picture, target, report)


def import_pmtiles(source: Path, target: Path, report: Report) -> None:
    """Import a PMTiles archive.

    Raises: ConfigError: no PMTiles archive, or one of vector tiles.
    """
    try:
        from pmtiles.reader import MmapSource, Reader, all_tiles
    except ImportError as error:
        raise _make_missing_error("pmtiles") from error
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
        metadata = _make_metadata(target, GeoBounds(*degrees), low, high, "")
        with TileWriter(target, metadata) as writer:
            for done, (address, data) in enumerate(itertools.chain([first], tiles), start=1):
                writer.put(*address, data)
                report(done, max(count, done))


def import_from_server(
    template: str, target: Path, bounds: GeoBounds, zooms: tuple[int, int], attribution: str,
    report: Report,
) -> MissingTiles:  # fmt: skip
    """Fetch a region once; tiles that are there already are not requested again.

    Raises: ConfigError: no template, too many tiles, a map of something else under that name, or
        the server does not give any.
    """
    check_template(template)
    count, absent, failed, why = _check_count(bounds, *zooms), 0, 0, ""
    is_new = _begins_new(target, template)
    about = {"attribution": attribution, SERVER: _sum_up(template)}
    joined = (bounds, zooms) if is_new else _join_extent(target, bounds, zooms)
    metadata = {**_make_metadata(target, joined[0], *joined[1], ""), **about}
    with (
        TileWriter(target, metadata if is_new else {}) as writer,
        ThreadPoolExecutor(PARALLEL) as pool,
    ):
        missing = (tile for tile in iterate_tiles(bounds, *zooms) if not writer.has(*tile))
        done = count - sum(not writer.has(*tile) for tile in iterate_tiles(bounds, *zooms))
        while batch := list(itertools.islice(missing, PARALLEL * 4)):
            for tile, answer in zip(batch, pool.map(lambda t: _try_fetch(template, t), batch),
                                    strict=True):  # fmt: skip
                done += 1
                if isinstance(answer, bytes):
                    writer.put(*tile, answer)
                elif getattr(answer, "code", None) in NONE_THERE:
                    absent += 1
                else:
                    failed += 1
                why = why if isinstance(answer, bytes) else str(answer)
                report(done, count)
        if absent + failed < count:
            writer.describe(metadata)
    if absent + failed == count:
        if is_new:
            target.unlink()
        raise ConfigError(f"no tile came from {template}: {why}")
    return MissingTiles(absent, failed, why)


def register_server(template: str, target: Path, zooms: tuple[int, int], attribution: str) -> None:
    """Register a map whose tiles are fetched when they are first shown, and then kept.

    Raises: ConfigError: no template, or a map of something else under that name.
    """
    check_template(template)
    _begins_new(target, template)
    world = GeoBounds(-180.0, -85.0, 180.0, 85.0)
    metadata = {
        **_make_metadata(target, world, *zooms, ""),
        "attribution": attribution,
        LIVE: template,
        SERVER: _sum_up(template),
    }
    with TileWriter(target, metadata):
        pass


def _begins_new(target: Path, template: str) -> bool:
    """Tell whether there is no map yet.

    Raises: ConfigError: there is one that came from elsewhere.
    """
    if not target.exists():
        return True
    try:
        server, live = read_note(target, SERVER), read_note(target, LIVE)
    except sqlite3.Error:
        server = live = ""
    if template == live or _sum_up(template) == server:
        return False
    came = "another address" if server or live else "elsewhere"
    raise ConfigError(
        f"there is a map '{target.stem}' already, whose tiles came from {came}; take another "
        f"--name, or first: agribot map remove {target.stem}"
    )


def _sum_up(template: str) -> str:
    """Sum an address up: it may hold a key, which others who get the map need not know."""
    return hashlib.sha256(template.encode()).hexdigest()


def _join_extent(
    target: Path, bounds: GeoBounds, zooms: tuple[int, int]
) -> tuple[GeoBounds, tuple[int, int]]:
    """Join a region with that of the map which it comes to."""
    try:
        known = describe_map(target)
    except ConfigError:  # no tile came yet
        return bounds, zooms
    old = GeoBounds(*known["bounds"]) if known["bounds"] else bounds
    joined = (
        *map(min, bounds[:2], old[:2]),
        *map(max, bounds[2:], old[2:]),
    )
    first, last = min(zooms[0], known["minzoom"]), max(zooms[1], known["maxzoom"])
    return GeoBounds(*joined), (first, last)


def fetch_tile(template: str, tile: MapTile) -> bytes:
    """Fetch a tile from a server.

    Raises: OSError: no answer. ValueError: the answer is no picture up to MAX_TILE_BYTES.
    """
    url = template.format(z=tile.z, x=tile.x, y=tile.y)
    request = urllib.request.Request(url, headers={"User-Agent": AGENT})
    try:
        with urllib.request.urlopen(request, timeout=TIMEOUT_S) as answer:
            data: bytes = answer.read(MAX_TILE_BYTES + 1)
    except urllib.error.HTTPError as error:
        error.close()
        raise
    except http.client.HTTPException as error:  # an answer that is no HTTP, or no address
        raise OSError(f"{url}: {type(error).__name__}: {error}") from error
    if len(data) > MAX_TILE_BYTES or not is_picture(data):
        raise ValueError(f"{url} gave {len(data)} bytes that are no picture of a tile")
    return data


def check_template(template: str) -> None:
    """Check the address template of a tile server.

    Raises: ConfigError: not an address of a tile server.
    """
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


def _try_fetch(template: str, tile: MapTile) -> bytes | Exception:
    try:
        return fetch_tile(template, tile)
    except (OSError, ValueError) as error:
        return error


def _choose_zoom(pixel_m: float) -> int:
    """Return the zoom whose pixels are at least as fine as the picture's, `pixel_m`."""
    zoom = math.ceil(math.log2(2.0 * HALF_M / TILE_PX / pixel_m) - 0.01)
    return clamp(zoom, 0, MAX_ZOOM)


def _choose_first_zoom(bounds: GeoBounds, last: int) -> int:
    zoom = last
    while zoom > 0 and count_tiles(bounds, zoom, zoom) > OVERVIEW_TILES:
        zoom -= 1
    return zoom


def _check_count(bounds: GeoBounds, first: int, last: int) -> int:
    if not 0 <= first <= last <= MAX_ZOOM:
        raise ConfigError(f"zooms {first} to {last}: must be within 0 to {MAX_ZOOM}, in order")
    count = count_tiles(bounds, first, last)
    if count > MAX_TILES:
        raise ConfigError(
            f"that would be {count} tiles, more than {MAX_TILES}; choose a smaller region or zoom"
        )
    return count


def _make_metadata(
    target: Path, bounds: GeoBounds, first: int, last: int, picture_format: str
) -> dict[str, str]:
    metadata = {"name": target.stem, "bounds": bounds.to_text(), "minzoom": str(first),
            "maxzoom": str(last), "type": "baselayer"}  # fmt: skip
    return {**metadata, "format": picture_format} if picture_format else metadata


def _load_rasterio() -> Any:
    try:
        import rasterio
        import rasterio.errors
    except ImportError as error:
        raise _make_missing_error("rasterio") from error
    return rasterio


def _make_missing_error(package: str) -> ConfigError:
    return ConfigError(f"this needs {package}; install it with {format_install('maps')}")
