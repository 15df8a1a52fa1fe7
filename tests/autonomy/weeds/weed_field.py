"""A strip of field with known plants, and a robot that sees them imperfectly."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from agribot.autonomy.weeds.map import WeedMap
from agribot.core.config import WeedConfig
from agribot.core.messages import (
    Estimate,
    FloatArray,
    GnssQuality,
    GroundPlant,
    MappedPlant,
    PlantClass,
    Scene,
)

LENGTH_M = 8.0
HALF_WIDTH_M = 0.5
VIEW_BODY_M = ((0.3, 0.45), (0.3, -0.45), (1.5, -0.75), (1.5, 0.75))
TICK_S = 0.02
TICKS_PER_FRAME = 5
SPEED_MPS = 0.4


def make_estimate(
    t_s: float,
    x_m: float,
    y_m: float,
    yaw_rad: float,
    *,
    v_mps: float = SPEED_MPS,
    yaw_rate_radps: float = 0.0,
    pos_std_m: float = 0.01,
    yaw_std_rad: float = 0.005,
    ok: bool = True,
) -> Estimate:
    p, q = pos_std_m**2, yaw_std_rad**2
    return Estimate(
        t_s=t_s,
        x_map_m=x_m,
        y_map_m=y_m,
        yaw_map_rad=yaw_rad,
        v_mps=v_mps,
        yaw_rate_radps=yaw_rate_radps,
        slip_rad=0.0,
        pose_cov=(p, 0.0, 0.0, 0.0, p, 0.0, 0.0, 0.0, q),
        pos_std_m=pos_std_m,
        yaw_std_rad=yaw_std_rad,
        quality=GnssQuality.RTK_FIXED,
        ok=ok,
    )


def make_scene(
    t_s: float, plants: tuple[GroundPlant, ...], view: tuple[tuple[float, float], ...] = VIEW_BODY_M
) -> Scene:
    return Scene(t_s=t_s, ready_s=t_s + 0.2, frame_index=0, plants=plants, view_body_m=view)


def make_plant(
    x_m: float,
    y_m: float,
    plant: PlantClass = PlantClass.WEED,
    *,
    std_m: float = 0.03,
    confidence: float = 0.85,
) -> GroundPlant:
    return GroundPlant(
        x_body_m=x_m, y_body_m=y_m, plant=plant, area_m2=0.002, confidence=confidence, std_m=std_m
    )


def add_sightings(
    weed_map: WeedMap,
    weeds_m: Sequence[tuple[float, float]],
    crops_m: Sequence[tuple[float, float]] = (),
    times: int = 6,
    from_s: float = 0.0,
) -> None:
    """Let a robot standing at the map's origin, facing East, see plants there several times."""
    seen = [make_plant(x, y, PlantClass.WEED, std_m=0.01) for x, y in weeds_m]
    seen += [make_plant(x, y, PlantClass.CROP, std_m=0.01) for x, y in crops_m]
    for i in range(times):
        t_s = from_s + 0.1 * i
        weed_map.track_pose(make_estimate(t_s, 0.0, 0.0, 0.0, v_mps=0.0))
        weed_map.add(make_scene(t_s, tuple(seen), view=()))


@dataclass(frozen=True)
class Eyes:
    """How badly the robot sees and how badly it knows where it is."""

    noise_m: float = 0.03
    detection: float = 0.8
    false_ratio: float = 0.05
    confusion: float = 0.10
    pos_std_m: float = 0.01
    yaw_std_rad: float = 0.005
    yaw_bias_rad: float = 0.0


@dataclass
class Walk:
    """One drive along the strip: the map it made and the truth."""

    weeds_m: FloatArray
    crops_m: FloatArray
    map: WeedMap = field(default_factory=lambda: WeedMap(WeedConfig()))


def plant_strip(rng: np.random.Generator, weeds: int) -> tuple[FloatArray, FloatArray]:
    """Weeds at random at least 13 cm from any plant, and a crop row with a plant per half metre."""
    crops = [(x, 0.0) for x in np.arange(0.25, LENGTH_M, 0.5)]
    placed: list[tuple[float, float]] = []
    while len(placed) < weeds:
        x, y = rng.uniform(0.0, LENGTH_M), rng.uniform(-HALF_WIDTH_M, HALF_WIDTH_M)
        if all(math.dist((x, y), other) > 0.13 for other in (*crops, *placed)):
            placed.append((x, y))
    return np.array(placed), np.array(crops)


def walk(seed: int, eyes: Eyes, passes: int = 1, weeds: int = 30) -> Walk:
    rng = np.random.default_rng(seed)
    weeds_m, crops_m = plant_strip(rng, weeds)
    result = Walk(weeds_m=weeds_m, crops_m=crops_m)
    t_s = 0.0
    for leg in range(passes):
        error = rng.normal(0.0, [eyes.pos_std_m, eyes.pos_std_m, eyes.yaw_std_rad])
        error[2] += eyes.yaw_bias_rad
        for tick, pose in enumerate(drive(back=leg % 2 == 1)):
            x, y, yaw = pose + error
            estimate = make_estimate(
                t_s, x, y, yaw, pos_std_m=eyes.pos_std_m, yaw_std_rad=eyes.yaw_std_rad
            )
            result.map.track_pose(estimate)
            if tick % TICKS_PER_FRAME == 0:
                result.map.add(look(rng, t_s, pose, result, eyes))
            t_s += TICK_S
    return result


def drive(back: bool) -> Iterator[FloatArray]:
    """True poses of one pass, one per tick."""
    for x_m in np.arange(-1.6, LENGTH_M + 0.2, SPEED_MPS * TICK_S):
        yield np.array([LENGTH_M - x_m, 0.0, math.pi] if back else [x_m, 0.0, 0.0])


def look(rng: np.random.Generator, t_s: float, pose: FloatArray, truth: Walk, eyes: Eyes) -> Scene:
    seen: list[GroundPlant] = []
    for places, plant in ((truth.weeds_m, PlantClass.WEED), (truth.crops_m, PlantClass.CROP)):
        for x_body, y_body in in_view(places, pose):
            if rng.random() < eyes.detection:
                x, y = rng.normal((x_body, y_body), eyes.noise_m)
                name = PlantClass(1 - plant) if rng.random() < eyes.confusion else plant
                seen.append(make_plant(x, y, name, std_m=eyes.noise_m))
    for _ in range(rng.poisson(eyes.false_ratio * len(seen))):
        name = PlantClass(int(rng.integers(2)))
        seen.append(make_plant(rng.uniform(0.35, 1.45), rng.uniform(-0.4, 0.4), name))
    return make_scene(t_s, tuple(seen))


def in_view(places_m: FloatArray, pose: FloatArray) -> FloatArray:
    """The places inside the view trapezium, in the body frame, (N, 2)."""
    cos_yaw, sin_yaw = math.cos(pose[2]), math.sin(pose[2])
    delta = places_m - pose[:2]
    x = cos_yaw * delta[:, 0] + sin_yaw * delta[:, 1]
    y = cos_yaw * delta[:, 1] - sin_yaw * delta[:, 0]
    inside = (x > 0.3) & (x < 1.5) & (np.abs(y) < 0.45 + 0.25 * (x - 0.3))
    return np.column_stack([x, y])[inside]


@dataclass(frozen=True)
class Score:
    precision: float
    recall: float
    error_m: FloatArray  # (N, 2) mapped minus true of the matched
    cov_m2: FloatArray  # (N, 2, 2)


def score(mapped: tuple[MappedPlant, ...], truth_m: FloatArray, radius_m: float = 0.10) -> Score:
    """One-to-one matches, nearest pairs first."""
    places = np.array([(p.x_map_m, p.y_map_m) for p in mapped]).reshape(-1, 2)
    gaps = np.linalg.norm(places[:, None] - truth_m[None], axis=2)
    pairs: list[tuple[int, int]] = []
    while gaps.size and gaps.min() <= radius_m:
        i, j = np.unravel_index(gaps.argmin(), gaps.shape)
        pairs.append((int(i), int(j)))
        gaps[i, :] = gaps[:, j] = math.inf
    mine, theirs = [i for i, _ in pairs], [j for _, j in pairs]
    return Score(
        precision=len(pairs) / max(len(mapped), 1),
        recall=len(pairs) / len(truth_m),
        error_m=places[mine] - truth_m[theirs],
        cov_m2=np.array([mapped[i].cov_m2 for i in mine]).reshape(-1, 2, 2),
    )
