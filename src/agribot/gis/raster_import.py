"""Georeferenced rasters as tiles of one file: GeoTIFF and whatever else GDAL reads."""

from __future__ import annotations

import contextlib
import io
import math
import tempfile
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from agribot.core.arithmetic import clamp
from agribot.core.errors import ConfigError
from agribot.gis.geo_pyramid import read_geo, write_vrt
from agribot.gis.map_import import Report, check_count, make_metadata, make_missing_error
from agribot.gis.mbtiles import TileWriter
from agribot.gis.raster_colours import RasterColours, find_colours
from agribot.gis.tile_grid import (
    HALF_M,
    MAX_ZOOM,
    TILE_PX,
    GeoBounds,
    MapTile,
    count_tiles,
    iterate_tiles,
)

if TYPE_CHECKING:
    import rasterio

WEB, DEGREES = "EPSG:3857", "EPSG:4326"
OVERVIEW_TILES = 4  # the coarsest zoom shows the whole picture on about this many
WEBP_QUALITY = 85


def import_geotiff(source: Path, target: Path, report: Report) -> tuple[str, ...]:
    """Import any georeferenced raster that GDAL reads, resampled to the grid of web tiles.

    Returns notes on what its pixels were taken for.
    Raises: ConfigError: not readable, without a place or a picture, or larger than MAX_TILES.
    """
    rasterio = _load_rasterio()
    try:
        with contextlib.ExitStack() as stack:
            stack.enter_context(warnings.catch_warnings(action="ignore"))
            raster = stack.enter_context(rasterio.open(source))
            bounds, pixel_m = _find_place(raster, source.name)
            palette = _read_palette(raster)
            colours = None if palette is not None else find_colours(raster, source.name)
            if colours is not None and colours.untagged is not None:
                raster = stack.enter_context(_untag_alpha(raster, colours.untagged))
            _draw_tiles(raster, target, bounds, pixel_m, palette if colours is None else colours,
                        source.name, report)  # fmt: skip
            return () if colours is None else colours.notes
    except rasterio.errors.RasterioError as error:
        raise ConfigError(
            f"cannot read {source} as a raster: {error}; export it as GeoTIFF"
        ) from error


def _draw_tiles(
    raster: rasterio.DatasetReader, target: Path, bounds: GeoBounds, pixel_m: float,
    colours: Any, name: str, report: Report,
) -> None:  # fmt: skip
    last = _choose_zoom(pixel_m)
    first = _choose_first_zoom(bounds, last)
    count, drawn = check_count(bounds, first, last), 0
    with TileWriter(target, make_metadata(target, bounds, first, last, "webp")) as writer:
        for done, tile in enumerate(iterate_tiles(bounds, first, last), start=1):
            data = _draw_tile(raster, tile, colours)
            if data:
                writer.put(*tile, data)
                drawn += 1
            report(done, count)
    if not drawn:
        raise ConfigError(
            f"{name} has no picture that a map can show: every pixel is marked as without data, or "
            "lies beyond 85 degrees North or South; export another part"
        )


@contextlib.contextmanager
def _untag_alpha(raster: rasterio.DatasetReader, band: int) -> Iterator[rasterio.DatasetReader]:
    """Open the same raster with a band that is marked as alpha as one of unknown meaning."""
    import rasterio.shutil
    from rasterio.enums import ColorInterp

    kinds = list(raster.colorinterp)
    kinds[band - 1] = ColorInterp.undefined
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "untagged.vrt"
        rasterio.shutil.copy(raster, path, driver="VRT")
        with rasterio.open(path, "r+") as copy:
            copy.colorinterp = kinds
        with rasterio.open(path) as copy:
            yield copy


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


def _draw_tile(raster: rasterio.DatasetReader, tile: MapTile, colours: Any) -> bytes:
    """Draw a tile as WebP; empty bytes where the picture has no data.

    `colours` are a palette (256, 4) or RasterColours.
    """
    from PIL import Image

    is_palette = not isinstance(colours, RasterColours)
    pixels, alpha = _read_tile_pixels(raster, tile, None if is_palette else colours)
    if not alpha.any():
        return b""
    if is_palette:
        rgba = colours[pixels[0]]
        rgba[alpha == 0] = 0
    else:
        drawn = colours.to_bytes(pixels)
        shown = drawn if len(drawn) == 3 else np.repeat(drawn, 3, axis=0)
        rgba = np.moveaxis(np.concatenate([shown, alpha[None]]), 0, 2)
    buffer = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(rgba), "RGBA").save(buffer, "WEBP", quality=WEBP_QUALITY)
    return buffer.getvalue()


def _read_tile_pixels(
    raster: rasterio.DatasetReader, tile: MapTile, colours: RasterColours | None
) -> tuple[Any, Any]:
    """Read the bands of a tile (bands, 256, 256) and how opaque its pixels are, 0 to 255."""
    from rasterio.enums import Resampling
    from rasterio.transform import from_bounds
    from rasterio.vrt import WarpedVRT

    grid = {"transform": from_bounds(*tile.compute_edges_m(), TILE_PX, TILE_PX),
            "width": TILE_PX, "height": TILE_PX}  # fmt: skip
    resampling = Resampling.nearest if colours is None else Resampling.bilinear
    alpha_band = None if colours is None else colours.alpha
    nodata = {} if colours is None or colours.nodata is None else {"src_nodata": colours.nodata}
    with WarpedVRT(
        raster, crs=WEB, resampling=resampling, add_alpha=alpha_band is None, **nodata, **grid
    ) as picture:
        at = alpha_band or picture.count
        pixels = picture.read(list((1,) if colours is None else colours.bands))
        alpha = picture.read(at).astype(np.float64)
    top = _find_top(raster) if colours is None or alpha_band is None else colours.alpha_top
    alpha *= np.isfinite(pixels).all(axis=0)
    return pixels, np.clip(np.rint(alpha * (255.0 / top)), 0.0, 255.0).astype(np.uint8)


def _find_top(raster: rasterio.DatasetReader) -> float:
    """Find the value of an opaque pixel in an alpha band that GDAL adds."""
    kind = np.dtype(raster.dtypes[0])
    return float(np.iinfo(kind).max) if kind.kind in "ui" else 1.0


def import_geo(source: Path, target: Path, report: Report) -> tuple[str, ...]:
    """Import a multi-resolution image of mapviz.

    Raises: ConfigError: not such a file, a tile is missing, or it is turned.
    """
    with tempfile.TemporaryDirectory() as folder:
        picture = Path(folder) / f"{source.stem}.vrt"
        write_vrt(read_geo(source), picture)
        return import_geotiff(picture, target, report)


def _choose_zoom(pixel_m: float) -> int:
    """Return the zoom whose pixels are at least as fine as the picture's, `pixel_m`."""
    zoom = math.ceil(math.log2(2.0 * HALF_M / TILE_PX / pixel_m) - 0.01)
    return clamp(zoom, 0, MAX_ZOOM)


def _choose_first_zoom(bounds: GeoBounds, last: int) -> int:
    zoom = last
    while zoom > 0 and count_tiles(bounds, zoom, zoom) > OVERVIEW_TILES:
        zoom -= 1
    return zoom


def _load_rasterio() -> Any:
    try:
        import rasterio
        import rasterio.errors
    except ImportError as error:
        raise make_missing_error("rasterio") from error
    return rasterio
