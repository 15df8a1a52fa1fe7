"""The look of a scene that the world does not describe: soil, leaf colour and exposure."""

from __future__ import annotations

import msgspec

from agribot.core.world import Rgb


class Appearance(msgspec.Struct, frozen=True, kw_only=True):
    """Neutral by default. Tints and gains are factors on red, green and blue.

    `texture_seed` picks other soil and leaf textures, `soil_contrast` scales their relief and
    stains about the mean colour, `soil_scale` the size of clods and stones, `hue_spread` how
    much single plants differ in colour, `haze_per_m` how fast distance fades, `flint_cover_ratio`
    the share of the soil under angular stones of 1 to 6 cm. With an `auto_exposure_level` over 0
    each picture is exposed so that its mean is this grey level (before gamma), as a camera's
    automatic does.
    """

    texture_seed: int = 0
    soil_tint: Rgb = (1.0, 1.0, 1.0)
    soil_contrast: float = 1.0
    soil_scale: float = 1.0
    leaf_gain: Rgb = (1.0, 1.0, 1.0)
    hue_spread: float = 1.0
    white_balance: Rgb = (1.0, 1.0, 1.0)
    exposure: float = 1.0
    auto_exposure_level: float = 0.0
    gamma: float = 1.0
    haze_per_m: float = 0.003
    flint_cover_ratio: float = 0.0
