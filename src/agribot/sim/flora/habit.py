"""Parts of all species: leaves with small irregularities, stems and their arrangement."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from agribot.core.messages import FloatArray, PlantClass
from agribot.sim.flora.mesh import Leaves, Profile

GOLDEN_ANGLE_RAD = math.pi * (3.0 - math.sqrt(5.0))
STAGES = (0.25, 0.6, 1.0)  # growth stages that are modelled; plants take the nearest
SEEDLING_STAGE = 0.1  # growth of species whose seedlings have leaves of other shapes
Colour = tuple[int, int, int]


class Species(NamedTuple):
    """The appearance of a species.

    `habit` grows the leaves for a random generator and a stage in (0, 1], `leaf_rgb`,
    `rib_rgb` and `stalk_rgb` colour its cell of the leaf atlas, `veins` is the number of
    lateral veins (0: parallel ones, as grasses have), `nominal_size_m` the height of a plant
    of stage 1, `wear` the contrast of the blotches on its leaves. The first kind of leaves is
    what is drawn from afar; of a compound leaf it is an outline that is not drawn from near.
    `stages` are the growth stages that it has meshes of.
    """

    name: str
    plant: PlantClass
    nominal_size_m: float
    habit: Callable[[np.random.Generator, float], list[Leaves]]
    segments: int
    leaf_rgb: Colour
    rib_rgb: Colour
    stalk_rgb: Colour
    veins: int
    wear: float
    cell: int
    is_compound: bool = False
    stages: tuple[float, ...] = STAGES


def stem_blade(b: FloatArray) -> FloatArray:
    """Return the width of a stem along it, (n, s): 1 everywhere."""
    return np.ones_like(b)


def strap_blade(b: FloatArray) -> FloatArray:
    """Return the width of a strap along it, (n, s): one width nearly to its tip."""
    return np.clip(np.minimum(0.3 + 2.0 * b, (1.02 - b) / 0.3), 0.0, 1.0)


def grow_leaves(
    rng: np.random.Generator, yaw_rad: FloatArray, *, length: FloatArray, width: FloatArray,
    pitch_deg: FloatArray, curl: tuple[float, float], profile: Profile, petiole: float = 0.0,
    fold: float = 0.25, wave: float = 0.0, twist: float = 0.0, base_z: FloatArray | None = None,
    tone: FloatArray | None = None,
) -> Leaves:  # fmt: skip
    """Grow a leaf for each yaw (n,) with the small irregularities that every species has."""
    count = len(yaw_rad)
    base = np.zeros((count, 3))
    base[:, 2] = 0.0 if base_z is None else base_z
    return Leaves(
        length=length * rng.uniform(0.88, 1.12, count),
        width=width * rng.uniform(0.88, 1.12, count),
        pitch_rad=np.radians(pitch_deg + rng.normal(0.0, 5.0, count)),
        curl_rad=rng.uniform(*curl, count), yaw_rad=yaw_rad,
        fold=fold * rng.uniform(0.6, 1.4, count),
        twist_rad=rng.normal(0.0, 0.12 + twist, count), wave=np.full(count, wave),
        phase_rad=rng.uniform(0.0, 2 * np.pi, count),
        tone=(np.ones(count) if tone is None else tone) * rng.uniform(0.88, 1.12, count),
        base=base, petiole=petiole, profile=profile,
    )  # fmt: skip


def grow_stalk(rng: np.random.Generator, height: float, width: float) -> Leaves:
    yaw_rad = np.array([0.0, np.pi / 3, 2 * np.pi / 3]) + rng.uniform(0, np.pi)
    ones = np.ones(3)
    stem = grow_leaves(
        rng, yaw_rad, length=height * ones, width=width * ones, pitch_deg=90.0 * ones,
        curl=(0.0, 0.0), profile=stem_blade, fold=0.0,
    )  # fmt: skip
    return stem._replace(length=height * ones, pitch_rad=np.pi / 2 * ones, twist_rad=0 * ones)


def choose_leaf_count(rng: np.random.Generator, stage: float, few: int, many: int) -> int:
    return max(2, round(few + (many - few) * stage + rng.uniform(-1.0, 1.0)))


def arrange_spiral(rng: np.random.Generator, count: int) -> FloatArray:
    """Return the yaws of leaves (count,), turned by about the golden angle each, rad."""
    turn = rng.uniform(0, 2 * np.pi) + rng.choice([-1, 1]) * GOLDEN_ANGLE_RAD * np.arange(count)
    angles: FloatArray = turn + rng.normal(0, 0.2, count)
    return angles
