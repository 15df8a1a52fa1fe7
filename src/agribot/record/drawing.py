"""Figures on paper and on a page: colours, PNG bytes and SVG that follows the page's theme."""

from __future__ import annotations

import io
import re
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from agribot.core.messages import FloatArray

BLUE = "#2f6fde"
RED = "#d6382b"
GREEN = "#2c9a47"
GREY = "#8a8f98"
ORANGE = "#d98324"
# Crops and weeds differ by shape, because not everybody can distinguish their colours.
CROP_MARKER, WEED_MARKER = "^", "o"
# Colour of text and axes; in SVG it becomes the page's own text colour.
INK = "#1f2328"

_MAX_POINTS = 1200
_STYLE: Any = {
    "svg.fonttype": "none",
    "svg.hashsalt": "agribot",
    "font.family": "sans-serif",
    "font.size": 10.0,
    "text.color": INK,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.titlecolor": INK,
    "xtick.color": INK,
    "ytick.color": INK,
}
_UNUSED = re.compile(
    r'<\?xml.*?\?>|<!DOCTYPE.*?>|<metadata>.*?</metadata>|<!--.*?-->| xmlns(:\w+)?="[^"]*"'
    r'| id="[A-Za-z0-9]+_\d+"',
    re.DOTALL,
)


def new_figure(width_in: float, height_in: float) -> tuple[Figure, Axes]:
    """Make an empty figure that belongs to no window and no global state."""
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(width_in, height_in))
        figure.set_layout_engine("constrained", w_pad=0.12, h_pad=0.12)
        axes = figure.add_subplot()
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(True, color=GREY, alpha=0.25, linewidth=0.6)
    axes.set_axisbelow(True)
    return figure, axes


def encode_png(figure: Figure, width_px: int = 1200) -> bytes:
    buffer = io.BytesIO()
    with mpl.rc_context(_STYLE):
        figure.savefig(
            buffer, format="png", dpi=width_px / figure.get_figwidth(), facecolor="white"
        )
    return buffer.getvalue()


def encode_svg(figure: Figure, label: str) -> str:
    """Encode for use inside HTML: no references, text and axes in the page's colour."""
    buffer = io.BytesIO()
    with mpl.rc_context(_STYLE):
        figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None})
    text = _UNUSED.sub("", buffer.getvalue().decode())
    text = text.replace("xlink:href=", "href=").replace(INK, "currentColor").strip()
    return text.replace("<svg ", f'<svg role="img" aria-label="{label}" ', 1)


def thin(x: FloatArray, y: FloatArray, limit: int = _MAX_POINTS) -> tuple[FloatArray, FloatArray]:
    """Reduce a line (N,), (N,) to about `limit` points; the extremes of each stretch stay."""
    if len(x) <= limit:
        return x, y
    bins = np.array_split(np.arange(len(x)), limit // 2)
    low = np.nan_to_num(y, nan=np.inf)
    high = np.nan_to_num(y, nan=-np.inf)
    picked = [index for b in bins for index in (b[np.argmin(low[b])], b[np.argmax(high[b])])]
    keep = np.unique(np.concatenate([np.array(picked), np.flatnonzero(_find_gap_edges(y))]))
    return x[keep], y[keep]


def sample_every(values: FloatArray, limit: int = _MAX_POINTS) -> FloatArray:
    """Take every k-th row of (N, ...), so that at most about `limit` remain."""
    return values[:: max(1, -(-len(values) // limit))]


def _find_gap_edges(y: FloatArray) -> Any:
    """Find the first NaN of each gap of (N,): without it a line would cross the gap."""
    missing = np.isnan(y)
    return missing & ~np.concatenate([[False], missing[:-1]])
