"""The edge of a field and what of the robot must stay inside it."""

from __future__ import annotations

import msgspec
import numpy as np
import numpy.typing as npt


class FieldBounds(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Rings in the map, (N, 2) each, the first around the field and the others around its holes.

    They do not repeat their first point. The rectangle of the robot with its implement reaches
    `front_m` ahead of the body's origin, `rear_m` behind it and `half_width_m` to both sides.
    """

    rings_map_m: tuple[npt.NDArray[np.float64], ...]
    front_m: float
    rear_m: float
    half_width_m: float
