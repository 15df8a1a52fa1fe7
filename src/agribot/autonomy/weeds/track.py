"""One plant of the map as it is being learned: where, what, and whether it is there at all.

A position error has two parts. What differs from frame to frame (pixels, the plant's outline)
averages out with every sighting. What the frames share (the robot's own pose error, the camera
mount) does not, however often the plant is seen. Keeping the parts apart is what makes the
covariance of the map honest: split covariance, Julier and Uhlmann 2001. Within a pass, in which a
plant follows the corrections of the pose, the shared part is that of the pose now.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

from agribot.autonomy.weeds.poses import PoseAt
from agribot.core.arithmetic import clamp
from agribot.core.implement.plants import REASONS
from agribot.core.messages import GroundPlant, MappedPlant, PlantClass
from agribot.core.pose import Pose2

SHARED_STD_M = 0.01  # camera mount and flat-ground error that no sighting averages out
MIN_OWN_STD_M = 0.01  # least error of a plant's centre, by its outline

# A plant that comes into view again after this time is seen on another pass, with another error of
# the pose. Looks give its place anew if their own variance is at most this share of the variance
# that the poses of both passes leave; looks from the next row are worse than a good receiver.
LATER_PASS_S = 5.0
LEAST_NEWS_SHARE = 0.5

# Log-odds of existence. A network misses the same plant in several frames on end, so one miss
# says less than an independent one would: detection 0.5, clutter 0.05 per gate and frame.
HIT_LOGIT = math.log(0.5 / 0.05)
MISS_LOGIT = math.log(0.5 / 0.95)
MAX_EXISTS_LOGIT = 6.0
GONE_LOGIT = -2.0  # belief below which the track is dropped

# Limits of one frame's confidence. Networks are surer than they are right, and frames of one plant
# are alike.
CLASS_CONFIDENCE = (0.55, 0.9)
MAX_CLASS_LOGIT = 6.0


@dataclass(slots=True)
class PlantSighting:
    """A plant of one frame, placed in the map.

    `own_var_m2` is per axis; `xx, xy, yy_m2` is the covariance that the whole frame shares. Where
    its stem was seen, and not its leaves, `is_stem` is true.
    """

    x_map_m: float
    y_map_m: float
    own_var_m2: float
    xx_m2: float
    xy_m2: float
    yy_m2: float
    plant: PlantClass
    weed_logit: float
    area_m2: float
    is_stem: bool = False
    rest_m: tuple[float, float] | None = None  # the same by the pose as it was known at the capture


@dataclass(slots=True, eq=False)
class Track:
    """A plant of the map. `weed_logit` is the log-odds of weed against crop."""

    id: int
    x_map_m: float
    y_map_m: float
    own_var_m2: float
    xx_m2: float
    xy_m2: float
    yy_m2: float
    weed_logit: float
    exists_logit: float
    area_m2: float
    sightings: int
    first_seen_s: float
    last_seen_s: float
    treated_s: float | None = None
    is_confirmed: bool = False
    left: int = 0  # index into REASONS
    is_here: bool = True  # its place was seen on this pass
    apart: set[int] = field(default_factory=set)  # weeds that one picture showed beside this one
    # Its place in the map once the robot has left it: the mean place of all sightings, by the pose
    # as it was known then, the nearest looks first.
    rest_m: tuple[float, float] | None = None
    rest_weight: float = 0.0

    @property
    def is_mapped(self) -> bool:
        """Whether files and pages show it."""
        return self.is_confirmed or self.treated_s is not None

    @property
    def plant(self) -> PlantClass:
        return PlantClass.WEED if self.weed_logit >= 0.0 else PlantClass.CROP

    @property
    def confidence(self) -> float:
        """Probability that it exists and is what `plant` says."""
        return _probability(self.exists_logit) * _probability(abs(self.weed_logit))

    @property
    def std_m(self) -> float:
        """1 sigma of the position, of the two axes taken together."""
        return math.sqrt(self.own_var_m2 + (self.xx_m2 + self.yy_m2) / 2.0)

    @property
    def seen_std_m(self) -> float:
        """1 sigma per axis of the place as seen from the robot, whose own error is not in it."""
        return math.hypot(math.sqrt(self.own_var_m2), SHARED_STD_M)

    @property
    def radius_m(self) -> float:
        """Radius of a disc with the plant's area."""
        return math.sqrt(self.area_m2 / math.pi)

    def gap_m(self, other: PlantSighting | Track) -> float:
        return math.hypot(other.x_map_m - self.x_map_m, other.y_map_m - self.y_map_m)

    def gap_std_m(self, seen: PlantSighting) -> float:
        """1 sigma per axis of the gap to a sighting of this same plant."""
        shared_m2 = self.xx_m2 + self.yy_m2 + seen.xx_m2 + seen.yy_m2
        return math.sqrt(self.own_var_m2 + seen.own_var_m2 + shared_m2 / 2.0)

    def mahalanobis2(self, seen: PlantSighting) -> float:
        """Squared distance in sigmas, as if nothing were shared: the gate errs on the wide side."""
        own_m2 = self.own_var_m2 + seen.own_var_m2
        xx = own_m2 + self.xx_m2 + seen.xx_m2
        yy = own_m2 + self.yy_m2 + seen.yy_m2
        xy = self.xy_m2 + seen.xy_m2
        dx = seen.x_map_m - self.x_map_m
        dy = seen.y_map_m - self.y_map_m
        return (dx * dx * yy - 2.0 * dx * dy * xy + dy * dy * xx) / (xx * yy - xy * xy)

    def update(self, seen: PlantSighting, t_s: float) -> None:
        """Take in one more sighting of this plant.

        Sightings of one pass share one error, that of the current pose; another pass has another
        one, so that the first gives the place no better than its pose was.
        """
        self._mean_rest(seen.rest_m, seen.own_var_m2**-2)
        self.is_here &= t_s - self.last_seen_s <= LATER_PASS_S
        open_m2 = (self.xx_m2 + self.yy_m2 + seen.xx_m2 + seen.yy_m2) / 2.0
        if not self.is_here and seen.own_var_m2 <= LEAST_NEWS_SHARE * open_m2:
            self.own_var_m2 += (self.xx_m2 + self.yy_m2) / 2.0
            self.is_here = True
        if self.is_here:
            gain = self.own_var_m2 / (self.own_var_m2 + seen.own_var_m2)
            self._move_towards(seen, gain)
            self.xx_m2, self.xy_m2, self.yy_m2 = seen.xx_m2, seen.xy_m2, seen.yy_m2
        self.weed_logit = clamp(
            self.weed_logit + seen.weed_logit, -MAX_CLASS_LOGIT, MAX_CLASS_LOGIT
        )
        self.exists_logit = min(self.exists_logit + HIT_LOGIT, MAX_EXISTS_LOGIT)
        self.sightings += 1
        self.area_m2 += (seen.area_m2 - self.area_m2) / self.sightings
        self.last_seen_s = t_s

    def is_apart(self, other: Track) -> bool:
        """Whether some picture showed both as weeds, so that they are two."""
        return other.id in self.apart or self.id in other.apart

    def shift(self, shift: Pose2) -> None:
        """Follow a correction of the pose that it was seen from."""
        self.x_map_m, self.y_map_m = shift.transform(self.x_map_m, self.y_map_m)

    def rest(self) -> None:
        """Stand where the poses of all its sightings had it, now that the robot has left it."""
        if self.rest_m is not None:
            self.x_map_m, self.y_map_m = self.rest_m

    def _mean_rest(self, other_m: tuple[float, float] | None, weight: float) -> None:
        """Take a place, or another track's mean, into the mean place of all sightings."""
        if other_m is None or not weight:
            return
        x_m, y_m = self.rest_m or other_m
        self.rest_weight += weight
        gain = weight / self.rest_weight
        self.rest_m = x_m + gain * (other_m[0] - x_m), y_m + gain * (other_m[1] - y_m)

    def miss(self) -> None:
        """Count that it stood in full view and was not seen."""
        self.exists_logit += MISS_LOGIT

    def absorb(self, other: Track) -> None:
        """Take in a track that turned out to be the same plant."""
        self._fuse(other)
        self.weed_logit = clamp(
            self.weed_logit + other.weed_logit, -MAX_CLASS_LOGIT, MAX_CLASS_LOGIT
        )
        self.exists_logit = max(self.exists_logit, other.exists_logit)
        total = self.sightings + other.sightings
        self.area_m2 += (other.area_m2 - self.area_m2) * other.sightings / total
        self.sightings = total
        self.is_here |= other.is_here
        self._mean_rest(other.rest_m, other.rest_weight)
        self.first_seen_s = min(self.first_seen_s, other.first_seen_s)
        self.last_seen_s = max(self.last_seen_s, other.last_seen_s)
        if self.treated_s is None:
            self.treated_s = other.treated_s
        self.left = max(self.left, other.left)
        self.apart |= other.apart

    def earlier(self, by_s: float) -> Track:
        """Move its times to a clock that began `by_s` later."""
        treated_s = None if self.treated_s is None else self.treated_s - by_s
        return replace(
            self, first_seen_s=self.first_seen_s - by_s, last_seen_s=self.last_seen_s - by_s,
            treated_s=treated_s,
        )  # fmt: skip

    def message(self) -> MappedPlant:
        return MappedPlant(
            id=self.id,
            plant=self.plant,
            x_map_m=self.x_map_m,
            y_map_m=self.y_map_m,
            cov_m2=(
                self.own_var_m2 + self.xx_m2,
                self.xy_m2,
                self.xy_m2,
                self.own_var_m2 + self.yy_m2,
            ),
            area_m2=self.area_m2,
            confidence=self.confidence,
            sightings=self.sightings,
            first_seen_s=self.first_seen_s,
            last_seen_s=self.last_seen_s,
            treated_s=self.treated_s,
            left=REASONS[self.left] if self.treated_s is None else "",
        )

    def _fuse(self, other: Track) -> None:
        """Move towards another track by the gain that makes the bound of the error least.

        With gain k the own parts are independent, (1-k)^2 own + k^2 own', and the shared ones may
        be the same error: (1-k) shared + k shared' bounds it for any correlation. Equal shared
        parts give the gain of a Kalman filter.
        """
        shared_gap_m2 = (self.xx_m2 + self.yy_m2 - other.xx_m2 - other.yy_m2) / 4.0
        gain = (self.own_var_m2 + shared_gap_m2) / (self.own_var_m2 + other.own_var_m2)
        gain = clamp(gain, 0.0, 1.0)
        self._move_towards(other, gain)
        rest = 1.0 - gain
        self.xx_m2 = rest * self.xx_m2 + gain * other.xx_m2
        self.xy_m2 = rest * self.xy_m2 + gain * other.xy_m2
        self.yy_m2 = rest * self.yy_m2 + gain * other.yy_m2

    def _move_towards(self, other: PlantSighting | Track, gain: float) -> None:
        """Move by this share of the way to a second position with another own error."""
        rest = 1.0 - gain
        self.x_map_m += gain * (other.x_map_m - self.x_map_m)
        self.y_map_m += gain * (other.y_map_m - self.y_map_m)
        self.own_var_m2 = rest * rest * self.own_var_m2 + gain * gain * other.own_var_m2


def sighting(plant: GroundPlant, pose: PoseAt, then: Pose2 | None = None) -> PlantSighting:
    """Place a plant of the body frame in the map, with both parts of its error.

    `then` is the pose `map_from_body` as it was known at the capture, before any correction.
    """
    east_m, north_m = pose.map_from_body.rotate(plant.x_body_m, plant.y_body_m)
    c = pose.cov
    # d(map)/d(yaw) = (-north, east): a heading error swings the plant around the robot.
    xx = c[0] - 2.0 * north_m * c[2] + north_m * north_m * c[8]
    yy = c[4] + 2.0 * east_m * c[5] + east_m * east_m * c[8]
    xy = c[1] + east_m * c[2] - north_m * c[5] - north_m * east_m * c[8]
    low, high = CLASS_CONFIDENCE
    confidence = clamp(plant.confidence, low, high)
    logit = math.log(confidence / (1.0 - confidence))
    return PlantSighting(
        x_map_m=pose.x_map_m + east_m,
        y_map_m=pose.y_map_m + north_m,
        own_var_m2=max(plant.std_m, MIN_OWN_STD_M) ** 2,
        xx_m2=xx + SHARED_STD_M**2,
        xy_m2=xy,
        yy_m2=yy + SHARED_STD_M**2,
        plant=plant.plant,
        weed_logit=logit if plant.plant == PlantClass.WEED else -logit,
        area_m2=plant.area_m2,
        is_stem=plant.seen_height_m == 0.0,
        rest_m=None if then is None else then.transform(plant.x_body_m, plant.y_body_m),
    )


def new_track(id: int, seen: PlantSighting, t_s: float) -> Track:
    return Track(
        id=id,
        x_map_m=seen.x_map_m,
        y_map_m=seen.y_map_m,
        own_var_m2=seen.own_var_m2,
        xx_m2=seen.xx_m2,
        xy_m2=seen.xy_m2,
        yy_m2=seen.yy_m2,
        weed_logit=seen.weed_logit,
        exists_logit=0.0,
        area_m2=seen.area_m2,
        sightings=1,
        first_seen_s=t_s,
        last_seen_s=t_s,
        rest_m=seen.rest_m,
        rest_weight=seen.own_var_m2**-2,
    )


def _probability(logit: float) -> float:
    return 1.0 / (1.0 + math.exp(-logit))
