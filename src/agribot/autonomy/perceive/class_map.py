"""What a network says about an image."""

from __future__ import annotations

import msgspec

from agribot.autonomy.perceive.leaf_owners import OwnedLeaves
from agribot.autonomy.perceive.stems import PlantMaps
from agribot.core.errors import PerceptionError
from agribot.core.messages import ByteArray


class ClassMap(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The network's answer on an image, at the network's own resolution.

    `class_id` (h, w) holds `PlantClass` values and `confidence` (h, w) the probability of that
    class, 255 = certain. `scale_px` is (height, width) of the image over that of the map.
    `plants` holds the stems, None for a network that only outputs the classes of pixels. `owned`
    are the stems found and the leaves of each, None before the search. `doubt` is 1 less the mean
    probability that a leaf is one of a plant with its name, None with too little foliage or no
    stem. A value above `most_doubt`, which almost no picture of the network's own has, means that
    it does not know what the picture shows.
    """

    class_id: ByteArray
    confidence: ByteArray
    scale_px: tuple[float, float]
    plants: PlantMaps | None = None
    owned: OwnedLeaves | None = None
    doubt: float | None = None
    most_doubt: float | None = None

    def check_shape(self, map_shape: tuple[int, int]) -> None:
        """Refuse a ground lookup of pixels (h, w) that are not those of this map.

        Raises: PerceptionError: it is of another size.
        """
        if self.class_id.shape != map_shape:
            raise PerceptionError(
                f"class map is {self.class_id.shape}, the ground lookup {map_shape}; "
                "build the lookup for the segmenter's map_shape"
            )
