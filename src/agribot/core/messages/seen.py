"""What the camera network sees, and the plants of the map that grows from it."""

from __future__ import annotations

import math
from enum import IntEnum

import msgspec

from agribot.core.facts import AnyFact
from agribot.core.messages.arrays import Vec3


class PlantClass(IntEnum):
    """Class ids of masks and reports; colours red, green, blue."""

    WEED = 0
    CROP = 1
    SOIL = 2


class GroundPlant(msgspec.Struct, frozen=True, kw_only=True):
    """One plant seen in one frame, projected on the ground plane of the body frame.

    What was seen of it stands `seen_height_m` above the ground: 0 where that is the stem, None
    where it is leaves, whose height is only guessed from their area.
    """

    x_body_m: float
    y_body_m: float
    plant: PlantClass
    area_m2: float
    confidence: float
    std_m: float
    seen_height_m: float | None = None


class RowLine(msgspec.Struct, frozen=True, kw_only=True):
    """The crop row under the robot, as one frame shows it; the frame does not show which row.

    `offset_m` is how far the body's origin stands to the left of the row, `heading_rad` the
    robot's heading against the row's direction that it faces, counter-clockwise; both are None
    where too little of the row is in view. The first and the last plant are given as distances
    ahead along the row, None where they are not in view. Sigmas are those of one frame; errors that
    last for seconds come on top. `offset_m` holds for the point `at_ahead_m` ahead on the body's x
    axis: there its error is independent of the heading's.
    """

    t_s: float
    offset_m: float | None
    heading_rad: float | None
    offset_std_m: float
    heading_std_rad: float
    start_ahead_m: float | None = None
    end_ahead_m: float | None = None
    range_std_m: float = 0.1
    at_ahead_m: float = 0.0


class CropCover(msgspec.Struct, frozen=True, kw_only=True):
    """Leaves of crop over the ground, as one frame shows them; nothing may spray there.

    Square cells of the body frame, row by row from the corner at (`x_body_m`, `y_body_m`): columns
    run to the left (y), rows forwards (x). `crop` and `seen` hold a bit for each cell, the highest
    bit of a byte first, whether it shows crop, and whether the picture shows it at all; `weed`
    whether it shows weeds, empty if unknown.

    A network that finds plants gives more. `unknown` has the bits of vegetation that no stem
    explains, empty if unknown. `stems_body_m` are the stems of crop that leaves point to, and
    `owners` has two bytes for each set bit of `crop`, in their order: the first and the last stem
    that leaves in the cell point to, counted from 1, twice the same where there is but one; 0 where
    some leaf points to no stem of crop.
    """

    x_body_m: float
    y_body_m: float
    cell_m: float
    rows: int
    columns: int
    crop: bytes
    seen: bytes
    weed: bytes = b""
    unknown: bytes = b""
    stems_body_m: tuple[tuple[float, float], ...] = ()
    owners: bytes = b""


class WeedScores(msgspec.Struct, frozen=True, kw_only=True):
    """Scores of weeds' stems on the ground of one frame, by a network.

    Square cells of the body frame as those of `CropCover`. `scores` holds a byte for each: 0 where
    the picture does not show the cell, from 1, no stem there, to 255, one for certain.
    """

    x_body_m: float
    y_body_m: float
    cell_m: float
    rows: int
    columns: int
    scores: bytes


class Scene(msgspec.Struct, frozen=True, kw_only=True):
    """The network's view of the frame captured at `t_s`.

    It is to be there at `ready_s`: a simulation waits for that, in real time it is used as soon as
    it is there, and what comes later is late.

    `view_body_m` is the ground polygon that the camera covered, so that a plant that should
    have been seen and was not can count against its track.
    """

    t_s: float
    ready_s: float
    frame_index: int
    plants: tuple[GroundPlant, ...]
    view_body_m: tuple[tuple[float, float], ...]
    class_ratio: Vec3 = (0.0, 0.0, 0.0)
    row_line: RowLine | None = None
    crop_cover: CropCover | None = None  # None: the camera or the recording has none
    weed_scores: WeedScores | None = None  # None: the network or the recording has none
    picture_crc32: int = 0  # checksum of the picture's bytes; 0 where not computed
    doubt: float | None = None  # doubt of the network, 0 to 1 (perceive/doubt.py); None: not known
    unfit: str = ""  # text of `unfit_fact`
    unfit_fact: AnyFact | None = None  # why nothing else of the scene holds


class MappedPlant(msgspec.Struct, frozen=True, kw_only=True):
    """Position, 2x2 covariance (row by row) and the evidence for it."""

    id: int
    plant: PlantClass
    x_map_m: float
    y_map_m: float
    cov_m2: tuple[float, float, float, float]
    area_m2: float
    confidence: float
    sightings: int
    first_seen_s: float
    last_seen_s: float
    treated_s: float | None = None
    left: str = ""  # why it was not treated, as far as that is known

    @property
    def std_m(self) -> float:
        """The larger axis of the 1-sigma ellipse: root of the larger eigenvalue."""
        a, b, c, d = self.cov_m2
        half_trace = (a + d) / 2.0
        root = math.sqrt(max(((a - d) / 2.0) ** 2 + b * c, 0.0))
        return math.sqrt(max(half_trace + root, 0.0))
