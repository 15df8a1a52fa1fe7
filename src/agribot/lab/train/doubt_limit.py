"""How doubtful a network may be of a picture before it counts as one that it does not know."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from agribot.autonomy.perceive.segmenter import Segmenter
from agribot.core.messages import ByteArray

OWN_PERCENTILE = 95.0  # percentile of its own pictures, such as those that taught it
# Margin over these: drawn pictures end at 0.53, the median of photographs of an unknown crop is
# 0.75.
MARGIN = 0.15


def find_most_doubt(segmenter: Segmenter, pictures: Iterable[ByteArray]) -> float | None:
    """Find the limit from pictures that the network knows; None of a network without stems."""
    answers = (segmenter.segment(image_rgb).doubt for image_rgb in pictures)
    doubts = [doubt for doubt in answers if doubt is not None]
    if not doubts:
        return None
    return round(min(1.0, float(np.percentile(doubts, OWN_PERCENTILE)) + MARGIN), 3)
