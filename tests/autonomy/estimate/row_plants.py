"""A crop detector on paper: plants of known rows seen from the true pose, and its faults."""

from __future__ import annotations

import math

import msgspec
import numpy as np

from agribot.autonomy.estimate.localizer import Localizer
from agribot.core.config import FieldConfig
from agribot.core.messages import Estimate, FloatArray, GroundPlant, PlantClass, Scene
from tests.autonomy.estimate.noisy_rover import Recording
from tests.autonomy.estimate.playback import batches

PERIOD_S, LATENCY_S = 0.1, 0.2
VIEW_BODY_M = ((0.5, -0.45), (1.9, -1.1), (1.9, 1.1), (0.5, 0.45))


class Faults(msgspec.Struct, frozen=True, kw_only=True):
    """Errors of single looks, of a plant's place, of whole frames; shares missed and made up."""

    look_std_m: float = 0.02
    planting_std_m: float = 0.02
    frame_std_m: float = 0.01
    told_std_m: float = 0.03
    missed_ratio: float = 0.1
    false_per_frame: float = 0.1
    false_area_m2: float = 0.1
    bare_ratio: float = 0.0
    blind_s: tuple[float, float] = (math.inf, math.inf)


def crops(field: FieldConfig, spacing_m: float) -> list[tuple[float, float]]:
    """The places that the planter aimed at; rows run along the field's yaw."""
    yaw = math.radians(field.row_yaw_deg)
    x0, y0 = field.first_row_start_map_m
    count = math.floor(field.row_length_m / spacing_m + 1e-6) + 1
    return [
        (
            x0 + k * field.row_pitch_m * math.sin(yaw) + i * spacing_m * math.cos(yaw),
            y0 - k * field.row_pitch_m * math.cos(yaw) + i * spacing_m * math.sin(yaw),
        )
        for k in range(field.row_count)
        for i in range(count)
    ]


def scenes(
    recording: Recording,
    field: FieldConfig,
    spacing_m: float,
    faults: Faults,
    rng: np.random.Generator,
) -> list[Scene]:
    """What the camera delivers on the recorded drive, oldest first."""
    return scenes_of(recording, grow(field, spacing_m, faults, rng), faults, rng)


def grow(
    field: FieldConfig, spacing_m: float, faults: Faults, rng: np.random.Generator
) -> FloatArray:
    """Where plants stand, (N, 2): the planter errs, and some do not come up."""
    plants = np.array(crops(field, spacing_m))
    plants = plants + faults.planting_std_m * rng.standard_normal(plants.shape)
    return plants[rng.random(len(plants)) >= faults.bare_ratio]


def scenes_of(
    recording: Recording, plants: FloatArray, faults: Faults, rng: np.random.Generator
) -> list[Scene]:
    """What the camera delivers of these plants, oldest first."""
    found = []
    for frame in range(int(recording.truth[-1, 0] / PERIOD_S)):
        t_s = frame * PERIOD_S
        if faults.blind_s[0] <= t_s < faults.blind_s[1]:
            continue
        x, y, yaw = recording.pose(t_s)
        seen = _look((x, y, yaw), plants, faults, rng)
        found.append(
            Scene(
                t_s=t_s,
                ready_s=t_s + LATENCY_S,
                frame_index=frame,
                plants=tuple(seen),
                view_body_m=VIEW_BODY_M,
            )
        )
    return found


def _look(
    pose: tuple[float, float, float],
    plants: np.ndarray,
    faults: Faults,
    rng: np.random.Generator,
) -> list[GroundPlant]:
    x, y, yaw = pose
    cos, sin = math.cos(yaw), math.sin(yaw)
    body = (plants - (x, y)) @ np.array([[cos, -sin], [sin, cos]])
    visible = (body[:, 0] > 0.55) & (body[:, 0] < 1.9)
    visible &= np.abs(body[:, 1]) < 0.25 + 0.45 * body[:, 0]
    tilt = faults.frame_std_m * rng.standard_normal(2)
    seen = []
    for place in body[visible]:
        if rng.random() >= faults.missed_ratio:
            seen.append(_plant(place + tilt + faults.look_std_m * rng.standard_normal(2), faults))
    for _ in range(rng.poisson(faults.false_per_frame)):
        place = np.array([rng.uniform(0.6, 1.9), rng.uniform(-0.8, 0.8)])
        seen.append(_plant(place, faults, faults.false_area_m2))
    return seen


def _plant(place: np.ndarray, faults: Faults, area_m2: float = 0.12) -> GroundPlant:
    return GroundPlant(
        x_body_m=float(place[0]), y_body_m=float(place[1]), plant=PlantClass.CROP,
        area_m2=area_m2, confidence=0.9, std_m=faults.told_std_m,
    )  # fmt: skip


def watch(into: Localizer, recording: Recording, seen: list[Scene]) -> list[Estimate]:
    """Play a recording into a localizer with the scenes as they become ready."""
    estimates, at = [], 0
    for batch in batches(recording):
        estimates.append(into.update(batch))
        while at < len(seen) and seen[at].ready_s <= batch.t_s + 1e-9:
            into.observe(seen[at])
            at += 1
    return estimates
