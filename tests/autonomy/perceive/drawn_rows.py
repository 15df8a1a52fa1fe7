"""Covers and photographs of parallel rows in perspective, drawn by known geometry."""

from __future__ import annotations

import numpy as np

from agribot.autonomy.perceive.picture_rows import PictureRows
from agribot.core.messages import ByteArray, FloatArray

SOIL_RGB, PLANT_RGB = (120, 95, 70), (60, 140, 40)
PLANTS_IN_ROW = 24
FAR_RATIO = 0.1


def make_rows(across: float, down: float, foot: float, spacing: float) -> PictureRows:
    return PictureRows(across, down, foot, spacing, 1.0, 0.0)


def draw_cover(
    rows: PictureRows | None,
    rng: np.random.Generator,
    shape: tuple[int, int] = (192, 256),
    weeds: int = 40,
    radius: float = 0.13,
) -> FloatArray:
    """Draw the cover (H, W) of plants on rows, with weeds anywhere; None: weeds alone.

    Plants stand at equal distances along a row but for a tenth of it, and some are missing.
    """
    cover = np.zeros(shape)
    view = rows or make_rows(0.5, -0.1, 0.5, 0.5)
    if rows is not None:
        for foot in rows.find_feet():
            for k in range(PLANTS_IN_ROW):
                if rng.random() < 0.8:
                    away = 0.15 * (k + rng.uniform(0.0, 1.0))
                    _draw_plant(
                        cover, view, foot + rng.normal(0.0, 0.03) * view.spacing_ratio, away, radius
                    )
    for _ in range(weeds):
        foot = view.across_ratio + rng.uniform(-4.0, 4.0)
        _draw_plant(cover, view, foot, rng.uniform(0.0, 3.6), radius / 2.0)
    return cover


def draw_photograph(cover: FloatArray, rng: np.random.Generator) -> ByteArray:
    """Draw a photograph (H, W, 3) of a cover in grainy colours."""
    colours = np.where(cover[..., None] > 0.5, PLANT_RGB, SOIL_RGB)
    grain = rng.normal(0.0, 6.0, cover.shape)[..., None]
    return np.clip(colours + grain, 0, 255).astype(np.uint8)


def _draw_plant(
    cover: FloatArray, view: PictureRows, foot: float, away: float, radius: float
) -> None:
    """Draw a round plant of a radius in spacings; `away` counts spacings from the lower edge."""
    height, width = cover.shape
    depth = 1.0 - view.down_ratio
    nearer = 1.0 / (1.0 + away)
    down = view.down_ratio + depth * nearer
    if down - view.down_ratio < FAR_RATIO:
        return
    across = view.across_ratio + (foot - view.across_ratio) * nearer
    wide = radius * view.spacing_ratio * nearer
    v = (np.arange(height)[:, None] + 0.5) / height - down
    u = (np.arange(width)[None, :] + 0.5) / width - across
    cover[(u / wide) ** 2 + (v / (0.8 * wide)) ** 2 <= 1.0] = 1.0
