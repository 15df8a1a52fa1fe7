"""What an implement may know of the plants around it; the weed map is one such."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple, Protocol

from agribot.core.messages import FloatArray, PlantClass
from agribot.core.pose import Pose2

# Reasons for a weed that was left, as far as an implement gets on its way to treat it: the last
# word counts.
REASONS = (
    "", "tool off", "seen too late", "outside the tool", "tool busy", "beside a crop",
    "stem of crop", "leaf of crop", "aimed at and not hit", "outside the prescription",
)  # fmt: skip


class Disc(NamedTuple):
    """Ground around a plant, in the map."""

    x_map_m: float
    y_map_m: float
    radius_m: float


class GroundBox(NamedTuple):
    """A box on the ground of the map, with half sides along and across the yaw of its middle."""

    middle: Pose2
    half_x_m: float
    half_y_m: float


class PlacedPlant(Protocol):
    """A plant at its place, whatever found it."""

    @property
    def id(self) -> int: ...
    @property
    def plant(self) -> PlantClass: ...
    @property
    def x_map_m(self) -> float: ...
    @property
    def y_map_m(self) -> float: ...
    @property
    def std_m(self) -> float: ...
    @property
    def area_m2(self) -> float: ...
    @property
    def treated_s(self) -> float | None: ...


class KnownPlant(PlacedPlant, Protocol):
    """A plant as far as it is known; `std_m` is 1 sigma of its place, `area_m2` of its leaves.

    `seen_std_m` is 1 sigma of its place seen from the robot: without what the pose was off by, the
    same for the plant and for the tool that comes to it.
    """

    @property
    def seen_std_m(self) -> float: ...
    @property
    def is_confirmed(self) -> bool: ...


class CropCells(Protocol):
    """Ground as the last looks showed it: under leaves of crop, bare, or not looked at."""

    def covers(
        self, box: GroundBox, known: Sequence[Disc] = (), stems: Sequence[Disc] = ()
    ) -> bool:
        """Whether crop covers any of a box on the ground.

        Leaves that lie in the discs `known`, or point to stems in the discs `stems`, do not count.
        """
        ...

    def is_seen(self, box: GroundBox) -> bool:
        """Whether all of a box on the ground was looked at."""
        ...

    def is_alone(self, plant: Disc) -> bool:
        """Whether hardly any crop grows around the disc: its leaves are those of one plant."""
        ...


class WeedCells(Protocol):
    """Ground as the looks of this pass suspect weeds on it, also those that are no plants yet."""

    def find_scores(self, box: GroundBox, left_m: Sequence[float]) -> FloatArray:
        """Find how surely, 0 to 1, a stem of a weed stands in boxes `left_m` to the left, (N,)."""
        ...


class PlantMap(Protocol):
    """The plants around the robot, for its implement to work on and to spare."""

    @property
    def crop_ground(self) -> CropCells: ...
    @property
    def weed_ground(self) -> WeedCells: ...

    def inside(
        self, x_min_m: float, y_min_m: float, x_max_m: float, y_max_m: float
    ) -> Iterable[KnownPlant]:
        """Plants in a rectangle of the map, and some just outside."""
        ...

    def mark_treated(self, id: int, t_s: float) -> None:
        """Note the first treatment of a plant."""
        ...

    def note_left(self, id: int, reason: str) -> None:
        """Note why a weed is not treated now, one of `REASONS`; the last of them counts."""
        ...
