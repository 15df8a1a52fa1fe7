"""What the numbers of a raster are: which bands are its colours, what is dark, bright and no data.

A type of pixels does not say it: 12 bits lie in numbers of 16, reflectance in whole numbers up to
10,000, and the fourth band of a multispectral camera is often marked as alpha. The data does.
"""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from agribot.core.errors import ConfigError

if TYPE_CHECKING:
    import rasterio

SAMPLE_PX = 1024  # side of the sample that a whole raster is judged by
CUT_PERCENT = (2.0, 98.0)  # black and white, as GIS programs stretch pictures
# Numbers that stand for "no data" by habit, where a file does not state one.
USUAL_NODATA = (-9999.0, -99999.0, -32768.0, -32767.0, -10_000.0, 65_535.0)
_BEYOND_DATA = 1e20  # a number as large, such as the least of a float, stands for none, too
_OPAQUE_SHARE = 0.5  # share of fully shown pixels among those that an alpha band shows
_MASK_VALUES = 16  # largest number of values by which an alpha band is one
_INDEX_MOST = 2.0  # largest value of vegetation indices and reflectance; heights have more
_SMOOTH_RATIO = 0.02  # step between neighbours over the span: ground, not a picture
_HEIGHT_WORDS = re.compile(r"(?i)(^|[^a-z])(dem|dsm|dtm|dgm|chm|ndsm|heights?|elevation)([^a-z]|$)")
_METRES = ("m", "metre", "meter", "metres", "meters")


class RasterColours(NamedTuple):
    """Colours of a raster.

    `bands` are the numbers, from 1, of red, green and blue, or of the one grey band. `alpha` is
    the number of the alpha band, whose highest value is `alpha_top`; `untagged` is the number of a
    band that is marked as alpha but holds colour. Pixels are drawn from `black` to `white`.
    """

    bands: tuple[int, ...]
    alpha: int | None
    alpha_top: float
    untagged: int | None
    black: float
    white: float
    nodata: float | None
    notes: tuple[str, ...]

    def to_bytes(self, pixels: Any) -> Any:
        span = self.white - self.black
        scaled = (pixels.astype(np.float64) - self.black) * (255.0 / span)
        return np.clip(np.rint(np.nan_to_num(scaled)), 0.0, 255.0).astype(np.uint8)


def find_colours(raster: rasterio.DatasetReader, name: str) -> RasterColours:
    """Judge a raster by a sample of its pixels.

    Raises: ConfigError: heights, or numbers that are no colours.
    """
    if np.dtype(raster.dtypes[0]).kind not in "uif":
        raise ConfigError(
            f"{name}: pixels of type {raster.dtypes[0]} are no picture; export 8 or 16 bits"
        )
    sample = _read_sample(raster)
    tagged = _find_tagged_alpha(raster)
    is_mask = tagged is not None and _is_mask(sample[tagged - 1])
    alpha = tagged if is_mask else None
    bands = _find_bands(raster, alpha)
    nodata = _find_nodata(raster, sample[[band - 1 for band in bands]])
    untagged = tagged if tagged is not None and not is_mask else None
    if untagged is not None and nodata is None and not sample.any(axis=0).all():
        nodata = 0.0  # the edges, which such an alpha band leaves out
    shown = _select_shown(raster, sample, bands, alpha, tagged, nodata)
    if len(bands) == 1:
        _refuse_heights(raster, sample[bands[0] - 1], shown, name)
    black, white = _find_range(shown)
    return RasterColours(
        bands=bands,
        alpha=alpha,
        alpha_top=float(sample[alpha - 1].max(initial=1)) if alpha else 1.0,
        untagged=untagged,
        black=black,
        white=white,
        nodata=nodata,
        notes=tuple(_describe(raster, name, bands, untagged, (black, white))),
    )


def _read_sample(raster: rasterio.DatasetReader) -> Any:
    step = math.ceil(max(raster.width, raster.height) / SAMPLE_PX)
    return raster.read(out_shape=(raster.count, *_divide(raster, step)))


def _divide(raster: rasterio.DatasetReader, step: int) -> tuple[int, int]:
    return max(raster.height // step, 1), max(raster.width // step, 1)


def _find_tagged_alpha(raster: rasterio.DatasetReader) -> int | None:
    from rasterio.enums import ColorInterp

    kinds = raster.colorinterp
    is_alone = raster.count == 1
    return (
        kinds.index(ColorInterp.alpha) + 1 if ColorInterp.alpha in kinds and not is_alone else None
    )


def _is_mask(alpha: Any) -> bool:
    """Return whether a band is alpha, mostly 0 or opaque, and not a band of a camera."""
    shown = alpha[alpha > 0]
    if not shown.size:
        return True
    if len(np.unique(shown)) <= _MASK_VALUES:
        return True
    return shown.size < alpha.size and float(np.mean(shown == shown.max())) >= _OPAQUE_SHARE


def _find_bands(raster: rasterio.DatasetReader, alpha: int | None) -> tuple[int, ...]:
    """Find red, green and blue by their tags, else by their names, else the first three bands."""
    names = ("red", "green", "blue")
    tags = [kind.name.lower() for kind in raster.colorinterp]
    titles = [(title or "").strip().lower() for title in raster.descriptions]
    for known in (tags, titles):
        if all(name in known for name in names):
            return tuple(known.index(name) + 1 for name in names)
    others = tuple(band for band in raster.indexes if band != alpha)
    return others[:3] if len(others) >= 3 else others[:1]


def _find_nodata(raster: rasterio.DatasetReader, pixels: Any) -> float | None:
    """Return the stated number of no data, else a usual one that lies far from all others."""
    if raster.nodata is not None:
        return float(raster.nodata)
    finite = pixels[np.isfinite(pixels)]
    edges = (finite.min(), finite.max()) if finite.size and pixels.dtype != np.uint8 else ()
    for edge in edges:
        rest = finite[finite != edge].astype(np.float64)
        is_usual = edge in USUAL_NODATA or abs(float(edge)) >= _BEYOND_DATA
        if is_usual and rest.size and np.abs(rest - float(edge)).min() > np.ptp(rest):
            return float(edge)
    return math.nan if pixels.dtype.kind == "f" else None


def _select_shown(
    raster: rasterio.DatasetReader,
    sample: Any,
    bands: tuple[int, ...],
    alpha: int | None,
    tagged: int | None,
    nodata: float | None,
) -> Any:
    """Select the pixels of the colours that hold data, (bands, N)."""
    pixels = sample[[band - 1 for band in bands]]
    has_data = np.isfinite(pixels).all(axis=0)
    if alpha is not None:
        has_data &= sample[alpha - 1] > 0
    elif tagged is None:
        has_data &= raster.dataset_mask(out_shape=sample.shape[1:]) > 0
    if nodata is not None and not math.isnan(nodata):
        has_data &= (pixels != nodata).any(axis=0)
    return pixels[:, has_data]


def _find_range(shown: Any) -> tuple[float, float]:
    """Find the numbers that are drawn black and white: one range for all colours and tiles."""
    if shown.dtype == np.uint8 or not shown.size:
        return 0.0, 255.0
    black, white = (float(edge) for edge in np.percentile(shown, CUT_PERCENT))
    return (black, white) if white > black else (black - 1.0, black + 1.0)


def _refuse_heights(raster: rasterio.DatasetReader, band: Any, shown: Any, name: str) -> None:
    if shown.dtype == np.uint8 or not shown.size:
        return
    low, high = (float(edge) for edge in np.percentile(shown, CUT_PERCENT))
    title, unit = raster.descriptions[0] or "", raster.units[0] or ""
    is_named = bool(_HEIGHT_WORDS.search(title) or _HEIGHT_WORDS.search(name.partition(".")[0]))
    is_signed, span = shown.dtype.kind != "u", high - low
    is_ground = is_signed and max(abs(low), abs(high)) > _INDEX_MOST and _is_smooth(raster, span)
    if is_named or unit.lower() in _METRES or is_ground:
        raise ConfigError(
            f"{name} holds heights (one band of {shown.dtype}, {low:g} to {high:g}), not a "
            f"picture; draw them first: gdaldem hillshade {name} hillshade.tif; or, if it is a "
            "picture, store it in bytes: gdal_translate -ot Byte -scale"
        )


def _is_smooth(raster: rasterio.DatasetReader, span: float) -> bool:
    """Return whether neighbours in the middle of a raster are nearly equal, as heights are."""
    from rasterio.windows import Window

    width, height = (min(side, SAMPLE_PX // 2) for side in (raster.width, raster.height))
    at = (raster.width - width) // 2, (raster.height - height) // 2
    block = raster.read(1, window=Window(*at, width, height)).astype(np.float64)
    steps = np.abs(np.diff(block, axis=1))
    steps = steps[np.isfinite(steps) & (steps <= span)]
    return bool(steps.size and steps.mean() < _SMOOTH_RATIO * span)


def _describe(
    raster: rasterio.DatasetReader,
    name: str,
    bands: tuple[int, ...],
    untagged: int | None,
    drawn: tuple[float, float],
) -> list[str]:
    notes = []
    if raster.dtypes[0] != "uint8":
        notes.append(
            f"{name}: its {raster.dtypes[0]} pixels are drawn from {drawn[0]:g} (black) to "
            f"{drawn[1]:g} (white), the 2nd and 98th percentile of its data"
        )
    if untagged is not None:
        notes.append(
            f"{name}: band {untagged} is marked as alpha and holds a picture, such as near "
            "infrared; it is left out"
        )
    if raster.count - (len(bands) + (untagged is not None)) > 1:
        notes.append(f"{name}: bands {', '.join(map(str, bands))} of {raster.count} are drawn")
    return notes
