"""The weed map: plants of many frames, put together into places with evidence."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Iterator

import numpy as np

from agribot.autonomy.weeds.cells import CellIndex
from agribot.autonomy.weeds.crop_ground import CropGround
from agribot.autonomy.weeds.near_pairs import find_near_pairs
from agribot.autonomy.weeds.pose_shifts import UNSHIFTED, PoseShifts
from agribot.autonomy.weeds.poses import PoseAt, PoseHistory
from agribot.autonomy.weeds.track import GONE_LOGIT, PlantSighting, Track, new_track, sighting
from agribot.autonomy.weeds.view import GroundView
from agribot.autonomy.weeds.weed_ground import WeedGround
from agribot.core.config import WeedConfig
from agribot.core.implement.plants import REASONS
from agribot.core.messages import Estimate, MappedPlant, PlantClass, Scene
from agribot.core.pose import Pose2

GATE_CHI2 = 13.8  # 99.9 % of two degrees of freedom
REACH_SIGMA = 3.0
MAX_CLASS_COST = 4.4  # 2 ln(0.9 / 0.1): one plant in ten is called by the other name
# Distance of a plant's outline from the edge of the view; a nearer one may be cut.
VIEW_INSET_M = 0.05
# A plant under the leaves of another one of its class, within this part of their radius and seen
# less often by this factor, is that one seen twice.
DOUBLE_RADIUS_RATIO = 0.75
DOUBLE_SIGHTINGS_RATIO = 2
TENTATIVE_S = 20.0  # age at which an unconfirmed plant is forgotten
# Way from the last sight of a plant to the tool, and a little more: on this way it stands where it
# was seen from the robot, however the pose is corrected; farther on, where the map then had it.
NEAR_WAY_M = 1.0
LEAST_SHIFT_M = 0.0005


class WeedMap:
    """Feed every estimate to `track_pose`, every scene to `add`; ask for `weeds` and `crops`.

    Crops are mapped like weeds, so that the treatment can spare them; crops that cannot be
    separated are at least ground of `crop_ground`. A scene whose capture pose is unknown is dropped
    and counted in `scenes_dropped`.
    """

    def __init__(self, config: WeedConfig) -> None:
        self._config = config
        self._poses = PoseHistory()
        self._shifts = PoseShifts()
        self._shifted = UNSHIFTED  # the corrections that the plants near the robot followed
        self._near: dict[int, float] = {}  # plants seen lately, and the way driven until then
        self._tracks: dict[int, Track] = {}
        self._cells = CellIndex(max(0.25, config.merge_radius_m))
        self._tentative: deque[tuple[float, int]] = deque()
        self._next_id = 1
        self.crop_ground = CropGround()
        self.weed_ground = WeedGround()
        self.scenes_used = 0
        self.scenes_dropped = 0

    def track_pose(self, estimate: Estimate) -> None:
        """Remember where the robot is; call it every tick.

        What was seen lately follows the corrections of the pose.
        """
        self._poses.add(estimate)
        self._shifts.add(estimate)
        shift = self._shifts.total.compose(self._shifted.inverse())
        x_m, y_m = shift.transform(estimate.x_map_m, estimate.y_map_m)
        moved_m = math.hypot(x_m - estimate.x_map_m, y_m - estimate.y_map_m)
        if moved_m + NEAR_WAY_M * abs(shift.yaw_rad) >= LEAST_SHIFT_M:
            self._shift_near(shift)

    def add(self, scene: Scene, pose: PoseAt | None = None) -> None:
        """Take in a scene, seen from `pose` or else from the remembered pose at its capture."""
        then = None
        if pose is None and (known := self._poses.at(scene.t_s)) is not None:
            then, pose = known.map_from_body, self._shifts.follow(known, self._shifted)
        if pose is None:
            self.scenes_dropped += 1
            return
        self.scenes_used += 1
        if scene.crop_cover is not None:
            self.crop_ground.add(scene.crop_cover, pose)
        if scene.weed_scores is not None:
            self.weed_ground.add(scene.weed_scores, pose)
        seen = [sighting(p, pose, then) for p in scene.plants if p.plant != PlantClass.SOIL]
        view = GroundView(scene.view_body_m, pose)
        touched = self._associate(seen, view, scene.t_s)
        self._count_misses(view, scene.t_s)
        self._note_apart(touched)
        for track, _ in touched:
            self._merge_around(track, scene.t_s)
        self._forget_tentative(scene.t_s)

    def plants(
        self, min_sightings: int = 1, min_confidence: float = 0.0
    ) -> tuple[MappedPlant, ...]:
        """Everything mapped with at least this evidence, oldest first."""
        return tuple(
            track.message()
            for track in self._tracks.values()
            if track.sightings >= min_sightings and track.confidence >= min_confidence
        )

    @property
    def tracks(self) -> tuple[Track, ...]:
        """All there is to know, for the map of a run that goes on with this one."""
        return tuple(self._tracks.values())

    def restore(self, tracks: Iterable[Track]) -> None:
        """Go on with the map of an earlier run; before the first scene."""
        for track in sorted(tracks, key=lambda track: track.first_seen_s):
            self._tracks[track.id] = track
            self._next_id = max(self._next_id, track.id + 1)
            self._cells.place(track)
            if not track.is_confirmed:
                self._tentative.append((track.first_seen_s, track.id))

    def list_mapped(self) -> list[Track]:
        """List the plants that are sure enough to be in the map, and those that were treated.

        They are as they are now; a page may ask from a thread of its own.
        """
        return [track for track in list(self._tracks.values()) if track.is_mapped]

    def export_plants(self) -> tuple[MappedPlant, ...]:
        """Return the plants that a run leaves: one seen once or twice is not a plant yet."""
        return tuple(track.message() for track in self.list_mapped())

    def weeds(self) -> tuple[MappedPlant, ...]:
        """List confirmed weeds, oldest first."""
        return self._list_confirmed(PlantClass.WEED)

    def crops(self) -> tuple[MappedPlant, ...]:
        """List confirmed crop plants, oldest first."""
        return self._list_confirmed(PlantClass.CROP)

    @property
    def weed_count(self) -> int:
        return sum(t.is_confirmed and t.plant == PlantClass.WEED for t in self._tracks.values())

    def inside(
        self, x_min_m: float, y_min_m: float, x_max_m: float, y_max_m: float
    ) -> Iterator[Track]:
        """Tracks in a rectangle, and some just outside; the map must not change meanwhile."""
        return self._cells.inside(x_min_m, y_min_m, x_max_m, y_max_m)

    def mark_treated(self, id: int, t_s: float) -> None:
        """Note the first treatment of a plant; a treated plant is never forgotten."""
        track = self._tracks.get(id)
        if track is not None and track.treated_s is None:
            track.treated_s = t_s

    def note_left(self, id: int, reason: str) -> None:
        """Note why a weed is not treated now; of several reasons the last of `REASONS` counts."""
        track = self._tracks.get(id)
        if track is not None:
            track.left = max(track.left, REASONS.index(reason))

    def _list_confirmed(self, plant: PlantClass) -> tuple[MappedPlant, ...]:
        return tuple(
            t.message() for t in self._tracks.values() if t.is_confirmed and t.plant == plant
        )

    def _associate(
        self, seen: list[PlantSighting], view: GroundView, t_s: float
    ) -> list[tuple[Track, PlantSighting]]:
        """Give each sighting to a track, best pairs first, or start one; return both.

        At the edge of the picture no track starts from a stem: the leaves there may be those of a
        plant that stands beyond it.
        """
        pairs = sorted(
            (cost, index, track.id)
            for index, plant in enumerate(seen)
            for cost, track in self._candidates(plant)
        )
        partner: dict[int, int] = {}
        taken: set[int] = set()
        for _, index, id in pairs:
            if index not in partner and id not in taken:
                partner[index] = id
                taken.add(id)
        touched = []
        for index, plant in enumerate(seen):
            if index in partner:
                track = self._tracks[partner[index]]
                track.update(plant, t_s)
            elif plant.is_stem and not view.covers(plant.x_map_m, plant.y_map_m, 0.0):
                continue
            else:
                track = self._start(plant, t_s)
            if track.is_here:
                self._near[track.id] = self._shifts.way_m
            self._settle(track)
            touched.append((track, plant))
        return touched

    def _shift_near(self, shift: Pose2) -> None:
        """Let the plants and the crop ground near the robot follow a correction of its pose."""
        self._shifted = self._shifts.total
        self.crop_ground.shift(shift)
        self.weed_ground.shift(shift)
        seen_since_m = self._shifts.way_m - NEAR_WAY_M
        for id, way_m in list(self._near.items()):
            track = self._tracks.get(id)
            if track is None or way_m < seen_since_m:
                del self._near[id]
            if track is not None:
                track.shift(shift) if way_m >= seen_since_m else track.rest()
                self._cells.place(track)

    def _around(self, x_m: float, y_m: float, radius_m: float) -> Iterator[Track]:
        return self._cells.inside(x_m - radius_m, y_m - radius_m, x_m + radius_m, y_m + radius_m)

    def _candidates(self, seen: PlantSighting) -> Iterator[tuple[float, Track]]:
        """Tracks that may be this plant, with squared distance in sigmas plus a class cost."""
        radius_m = self._config.merge_radius_m
        for track in self._around(seen.x_map_m, seen.y_map_m, 2.0 * radius_m):
            reach_m = min(max(radius_m, REACH_SIGMA * track.gap_std_m(seen)), 2.0 * radius_m)
            if track.gap_m(seen) > reach_m:
                continue
            cost = track.mahalanobis2(seen)
            if track.plant != seen.plant:
                cost += min(2.0 * abs(track.weed_logit), MAX_CLASS_COST)
            if cost <= GATE_CHI2:
                yield cost, track

    def _start(self, seen: PlantSighting, t_s: float) -> Track:
        track = new_track(self._next_id, seen, t_s)
        self._next_id += 1
        self._tracks[track.id] = track
        self._tentative.append((t_s, track.id))
        return track

    def _settle(self, track: Track) -> None:
        """Bring index and confirmation up to date after a change."""
        self._cells.place(track)
        track.is_confirmed = (
            track.sightings >= self._config.min_sightings
            and track.confidence >= self._config.min_confidence
        )

    def _remove(self, track: Track) -> None:
        self._cells.remove(track)
        del self._tracks[track.id]

    def _count_misses(self, view: GroundView, t_s: float) -> None:
        if view.is_empty:
            return
        missed = [
            track
            for track in self._cells.inside(*view.bounds_map_m)
            if track.last_seen_s != t_s and view.covers(track.x_map_m, track.y_map_m, VIEW_INSET_M)
        ]
        for track in missed:
            track.miss()
            if track.exists_logit < GONE_LOGIT and track.treated_s is None:
                self._remove(track)
            else:
                self._settle(track)

    def _note_apart(self, touched: list[tuple[Track, PlantSighting]]) -> None:
        """Note which weeds this picture shows side by side, and which almost in one place."""
        weeds = [pair for pair in touched if pair[0].plant == PlantClass.WEED]
        xy_m = np.array([(seen.x_map_m, seen.y_map_m) for _, seen in weeds]).reshape(-1, 2)
        pairs = find_near_pairs(xy_m, 2.0 * self._config.merge_radius_m)
        gaps_m = np.hypot(*(xy_m[pairs[0]] - xy_m[pairs[1]]).T)
        for i, j, gap_m in zip(*pairs, gaps_m, strict=True):
            one, other = weeds[i][0], weeds[j][0]
            if gap_m > self._one_place_m:
                one.apart.add(other.id)
                other.apart.add(one.id)
            else:
                one.apart.discard(other.id)
                other.apart.discard(one.id)

    @property
    def _one_place_m(self) -> float:
        """Return the distance below which two plants of one picture are in one place."""
        return self._config.merge_radius_m / 4.0

    def _merge_around(self, track: Track, t_s: float) -> None:
        """Absorb tracks that have drifted onto this one, and forget doubles.

        Two plants seen side by side in one frame are two, unless they are almost in one place; two
        weeds that one picture showed so stay two until another shows them almost in one place.
        """
        if track.id not in self._tracks:
            return
        reach_m = max(self._config.merge_radius_m, DOUBLE_RADIUS_RATIO * track.radius_m)
        near = list(self._around(track.x_map_m, track.y_map_m, reach_m))
        near.remove(track)
        for other in near:
            if track.is_apart(other):
                continue
            if _is_double(other, track, t_s):
                self._remove(other)
            elif _is_double(track, other, t_s):
                self._remove(track)
                return
            elif self._is_same(track, other, t_s):
                track, gone = (track, other) if track.id < other.id else (other, track)
                self._join(track, gone)

    def _join(self, track: Track, gone: Track) -> None:
        """Let a track absorb another one, whose neighbours are now seen apart from it."""
        self._remove(gone)
        track.absorb(gone)
        self._settle(track)
        for id in gone.apart & self._tracks.keys():
            self._tracks[id].apart.add(track.id)

    def _is_same(self, track: Track, other: Track, t_s: float) -> bool:
        """Near, and of the same class or with too little seen of one to say."""
        radius_m = self._config.merge_radius_m
        if other.last_seen_s == t_s:
            limit_m = self._one_place_m
        else:
            own_std_m = math.sqrt(track.own_var_m2 + other.own_var_m2)
            limit_m = min(max(radius_m / 2.0, 2.0 * own_std_m), radius_m)
        few = min(track.sightings, other.sightings) < self._config.min_sightings
        return track.gap_m(other) <= limit_m and (few or track.plant == other.plant)

    def _forget_tentative(self, t_s: float) -> None:
        while self._tentative and self._tentative[0][0] < t_s - TENTATIVE_S:
            _, id = self._tentative.popleft()
            track = self._tracks.get(id)
            if track is not None and not track.is_confirmed and track.treated_s is None:
                self._remove(track)


def _is_double(track: Track, other: Track, t_s: float) -> bool:
    """Whether a plant is but a second stem that was seen at times under the leaves of another one.

    What came into view later has been seen less often, too: while both are in view it must be
    seen less often per second as well. A treated plant is never forgotten.
    """
    if track.treated_s is not None or track.plant != other.plant:
        return False
    seldom = DOUBLE_SIGHTINGS_RATIO * track.sightings
    is_seldom = seldom < other.sightings
    if is_seldom and track.first_seen_s <= other.last_seen_s:
        known_s, other_known_s = (t_s - track.first_seen_s, other.last_seen_s - other.first_seen_s)
        is_seldom = seldom * other_known_s < other.sightings * known_s
    return is_seldom and track.gap_m(other) <= DOUBLE_RADIUS_RATIO * other.radius_m
