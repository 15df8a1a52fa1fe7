"""How the camera is really mounted, from plants that it sees again while the robot drives.

A plant stands still. Seen with a wrong pitch or height it seems to come nearer too slowly or too
fast, with a wrong yaw it drifts aside, with a wrong roll the plants of both sides go unlike ways.
The mount is found at which every plant keeps its place best: the robot's own motion is the ruler,
no target is needed. Where on the body the camera sits, but for its height, does not show.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import msgspec
import numpy as np

from agribot.autonomy.perceive.foliage import find_height_m
from agribot.core.geo import rotation_from_rpy
from agribot.core.messages import FloatArray, GroundPlant, PlantClass
from agribot.core.pose import Pose2

# A plant is found again in the next picture by the robot's motion, within this error.
NEXT_M, NEXT_S = 0.06, 0.35
MIN_LOOKS, MIN_WAY_M = 6, 0.4
# Spread of the mount against its description, before anything is seen; it keeps unseen values back.
PRIOR_RAD, PRIOR_M = math.radians(10.0), 0.15
LEAST_STD_M, HUBER_SIGMA = 0.01, 1.5
# Errors from the supposed height of the leaves and the light on them, in the simulator.
MODEL_STD = (math.radians(0.3), math.radians(0.3), math.radians(0.1), 0.006)
PASSES, STEP = 12, 1e-5
MIN_TRACKS = 20
MAX_ANGLE_STD_RAD, MAX_HEIGHT_STD_M = math.radians(0.5), 0.015


class Look(NamedTuple):
    """Plants of one picture, placed with the described mount, and the robot's pose then."""

    t_s: float
    pose_map: tuple[float, float, float]
    plants: tuple[GroundPlant, ...]


class _Sight(NamedTuple):
    look: Look
    plant: GroundPlant


class MountFit(msgspec.Struct, frozen=True, kw_only=True):
    """Rotation of the real mount about the body's axes and its rise; 1 sigma of each.

    Positive pitch looks further down, positive yaw further left. `scatter` is how far plants seem
    to move, RMS, with the described mount and with the one found.
    """

    roll_rad: float
    pitch_rad: float
    yaw_rad: float
    height_m: float
    roll_std_rad: float
    pitch_std_rad: float
    yaw_std_rad: float
    height_std_m: float
    scatter_before_m: float
    scatter_m: float
    tracks: int
    looks: int

    def complaints(self) -> tuple[str, ...]:
        found = []
        if self.tracks < MIN_TRACKS:
            found.append(
                f"only {self.tracks} plants were followed over {MIN_WAY_M:.1f} m, {MIN_TRACKS} "
                "are needed; drive further along rows"
            )
        for name, std_rad in (
            ("roll", self.roll_std_rad), ("pitch", self.pitch_std_rad), ("yaw", self.yaw_std_rad),
        ):  # fmt: skip
            if std_rad > MAX_ANGLE_STD_RAD:
                found.append(
                    f"{name} is known to {math.degrees(std_rad):.1f} degrees only, "
                    f"{math.degrees(MAX_ANGLE_STD_RAD):.1f} are needed; drive further along rows"
                )
        if self.height_std_m > MAX_HEIGHT_STD_M:
            found.append(
                f"the height is known to {100 * self.height_std_m:.1f} cm only, "
                f"{100 * MAX_HEIGHT_STD_M:.1f} are needed; drive further along rows"
            )
        return tuple(found)


class _Tracks:
    """All sights of the plants that were followed far enough, as arrays; `plant` numbers them."""

    def __init__(self, tracks: Sequence[Sequence[_Sight]], body_from_camera: FloatArray) -> None:
        sights = [sight for track in tracks for sight in track]
        self.count, self.plant = len(tracks), np.repeat(
            np.arange(len(tracks)), [len(track) for track in tracks]
        )  # fmt: skip
        poses = np.array([sight.look.pose_map for sight in sights]).reshape(-1, 3)
        self._xy_m, self._cos, self._sin = poses[:, :2], np.cos(poses[:, 2]), np.sin(poses[:, 2])
        places = [(s.plant.x_body_m, s.plant.y_body_m, _estimate_height_m(s.plant)) for s in sights]
        self._heights_m = np.array([place[2] for place in places])
        self._centre_m = body_from_camera[:3, 3]
        self._rays_body = np.array(places).reshape(-1, 3) - self._centre_m
        std_m = np.array([max(sight.plant.std_m, LEAST_STD_M) for sight in sights])
        self.std_m: FloatArray = std_m

    def places_m(self, mount: FloatArray) -> FloatArray:
        """Places of the plants in the map with a mount (roll, pitch, yaw, height), (N, 2)."""
        rays = self._rays_body @ rotation_from_rpy(*mount[:3].tolist()).T
        height_m = self._centre_m[2] + mount[3]
        reach = (self._heights_m - height_m) / np.minimum(rays[:, 2], -1e-3)
        x_m, y_m = (self._centre_m[:2] + reach[:, None] * rays[:, :2]).T
        turned_m = [self._cos * x_m - self._sin * y_m, self._sin * x_m + self._cos * y_m]
        places_m: FloatArray = self._xy_m + np.column_stack(turned_m)
        return places_m

    def off_m(self, mount: FloatArray, weights: FloatArray) -> FloatArray:
        """Distance of every sight from the mean place of its plant, (N, 2)."""
        places_m = self.places_m(mount)
        total = np.bincount(self.plant, weights)
        means = np.column_stack(
            [np.bincount(self.plant, weights * axis) / total for axis in places_m.T]
        )
        off_m: FloatArray = places_m - means[self.plant]
        return off_m


def fit_mount(looks: Sequence[Look], body_from_camera: FloatArray) -> MountFit | None:
    """Fit the camera's mount to pictures in the order of their times, each with a pose (3,).

    None where no plant was followed far enough.
    """
    followed = follow(looks)
    if not followed:
        return None
    tracks = _Tracks(followed, body_from_camera)
    prior = np.diag(1.0 / np.square([PRIOR_RAD, PRIOR_RAD, PRIOR_RAD, PRIOR_M]))
    mount, even = np.zeros(4), 1.0 / tracks.std_m**2
    before_m = tracks.off_m(mount, even)
    weights, scale = even, 1.0
    for _ in range(PASSES):
        off_m = tracks.off_m(mount, weights)
        sigmas = np.hypot(off_m[:, 0], off_m[:, 1]) / tracks.std_m
        # The stated sigmas lack the error that looks at one plant share; its mean size is measured.
        scale = max(float(np.median(sigmas)), 1e-3)
        weights = even * np.minimum(1.0, HUBER_SIGMA * scale / np.maximum(sigmas, 1e-9)) / scale**2
        slopes = _slopes(tracks, mount, weights)
        normal = np.einsum("nap,n,naq->pq", slopes, weights, slopes) + prior
        gradient = np.einsum("nap,n,na->p", slopes, weights, off_m) + prior @ mount
        mount = mount - np.linalg.solve(normal, gradient)
    std = _std(tracks, mount, weights, prior)
    after_m = tracks.off_m(mount, even)
    return MountFit(
        roll_rad=float(mount[0]), pitch_rad=float(mount[1]), yaw_rad=float(mount[2]),
        height_m=float(mount[3]), roll_std_rad=float(std[0]), pitch_std_rad=float(std[1]),
        yaw_std_rad=float(std[2]), height_std_m=float(std[3]), scatter_before_m=_rms(before_m),
        scatter_m=_rms(after_m), tracks=tracks.count, looks=len(tracks.plant),
    )  # fmt: skip


def follow(looks: Sequence[Look]) -> list[list[_Sight]]:
    """Plants found again from picture to picture, whatever the mount: it errs alike in both."""
    growing: list[list[_Sight]] = []
    done: list[list[_Sight]] = []
    for look in looks:
        fresh = [track for track in growing if look.t_s - track[-1].look.t_s <= NEXT_S]
        done += [track for track in growing if look.t_s - track[-1].look.t_s > NEXT_S]
        growing = fresh
        expected = np.array([_predict_place(track[-1], look) for track in growing]).reshape(-1, 2)
        taken: set[int] = set()
        for plant in look.plants:
            index = _nearest(plant, expected, growing)
            if index is None:
                growing.append([_Sight(look, plant)])
            elif index not in taken:
                taken.add(index)
                growing[index].append(_Sight(look, plant))
    return [track for track in done + growing if _is_long(track)]


def _nearest(
    plant: GroundPlant, expected: FloatArray, tracks: Sequence[Sequence[_Sight]]
) -> int | None:
    if not len(expected):
        return None
    away_m = np.hypot(expected[:, 0] - plant.x_body_m, expected[:, 1] - plant.y_body_m)
    index = int(away_m.argmin())
    is_it = away_m[index] <= NEXT_M and tracks[index][-1].plant.plant is plant.plant
    return index if is_it else None


def _predict_place(sight: _Sight, look: Look) -> tuple[float, float]:
    """Predict where a plant that was seen before is to be seen now, body frame."""
    plant = sight.plant
    place_map_m = Pose2(*sight.look.pose_map).transform(plant.x_body_m, plant.y_body_m)
    return Pose2(*look.pose_map).locate(*place_map_m)


def _is_long(track: Sequence[_Sight]) -> bool:
    first, last = track[0].look.pose_map, track[-1].look.pose_map
    return len(track) >= MIN_LOOKS and math.dist(first[:2], last[:2]) >= MIN_WAY_M


def _estimate_height_m(plant: GroundPlant) -> float:
    """Estimate the height over the ground of a seen plant: of leaves, as `foliage` supposes."""
    if plant.seen_height_m is not None:
        return plant.seen_height_m
    if plant.plant is PlantClass.SOIL:
        return 0.0
    return find_height_m(plant.plant, plant.area_m2)


def _slopes(tracks: _Tracks, mount: FloatArray, weights: FloatArray) -> FloatArray:
    """Differentiate the offsets by the mount, (N, 2, 4)."""
    columns = []
    for index in range(4):
        step = np.zeros(4)
        step[index] = STEP
        up, down = tracks.off_m(mount + step, weights), tracks.off_m(mount - step, weights)
        columns.append((up - down) / (2.0 * STEP))
    return np.stack(columns, axis=2)


def _std(tracks: _Tracks, mount: FloatArray, weights: FloatArray, prior: FloatArray) -> FloatArray:
    """1 sigma of the mount, from how far plant by plant disagrees: its sights err together."""
    slopes, off_m = _slopes(tracks, mount, weights), tracks.off_m(mount, weights)
    pulls = np.einsum("nap,n,na->np", slopes, weights, off_m)
    each = np.stack([np.bincount(tracks.plant, pull) for pull in pulls.T], axis=1)
    inverse = np.linalg.inv(np.einsum("nap,n,naq->pq", slopes, weights, slopes) + prior)
    cov = inverse @ (each.T @ each + prior) @ inverse
    std: FloatArray = np.sqrt(np.diag(cov) + np.square(MODEL_STD))
    return std


def _rms(off_m: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.sum(off_m**2, axis=1))))
