"""Pixels of 10, 12, 14 and 16 bits, which lie in 16-bit numbers, as bytes.

Cameras put the bits of a pixel at the lower end of its 16-bit number (EMVA, GenICam Pixel Format
Naming Convention: Mono10, Mono12, Mono14), and neither PNG nor ROS states how many there are. The
brightest pixel is the best indication: the least of the usual depths that holds it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from agribot.core.messages import ByteArray

DEPTHS = (8, 10, 12, 14, 16)

Pixels = npt.NDArray[np.unsignedinteger[Any] | np.signedinteger[Any]]


def find_depth(pixels: Pixels) -> int:
    """Find the bits of a pixel; 16 for all that is brighter still."""
    brightest = int(pixels.max(initial=0))
    return next((bits for bits in DEPTHS if brightest < 1 << bits), DEPTHS[-1])


def narrow_pixels(pixels: Pixels, depth: int) -> ByteArray:
    """Keep the upper eight of `depth` bits."""
    return (pixels >> (depth - 8)).clip(0, 255).astype(np.uint8)
