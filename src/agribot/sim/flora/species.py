"""The plants that can grow in a simulated field, as functions of a variant and a growth stage.

Habits follow the look of the seedlings and rosettes of the real species; no scan or photograph
is used. Everything is scaled to unit height, so that the size of a plant is one factor.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from agribot.errors import DescriptionError
from agribot.messages import FloatArray, PlantClass
from agribot.sim.flora.mesh import (
    Leaves,
    Mesh,
    Profile,
    leaf_rhombi,
    leaf_strips,
    leaf_triangles,
    merged,
)

GOLDEN_ANGLE_RAD = math.pi * (3.0 - math.sqrt(5.0))
LODS = 5
STAGES = (0.25, 0.6, 1.0)  # growth stages that are modelled; plants take the nearest
Colour = tuple[int, int, int]


class Species(NamedTuple):
    """What a species looks like.

    `habit` grows the leaves for a random generator and a stage in (0, 1], `leaf_rgb`,
    `rib_rgb` and `stalk_rgb` colour its cell of the leaf atlas, `veins` is the number of
    lateral veins (0: parallel ones, as grasses have), `nominal_size_m` the height of a plant
    of stage 1 and `wear` the contrast of the blotches on its leaves.
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


def _beet_blade(b: FloatArray) -> FloatArray:
    return np.sin(np.pi * np.clip(b, 0, 1) ** 0.8) ** 0.7


def _ovate_blade(b: FloatArray) -> FloatArray:
    return np.sin(np.pi * np.clip(b, 0, 1) ** 0.72) ** 0.85


def _lettuce_blade(b: FloatArray) -> FloatArray:
    return np.clip(0.25 + 1.5 * b, 0, 1) * np.clip(6.0 * (1.02 - b), 0, 1) ** 0.5


def _maize_blade(b: FloatArray) -> FloatArray:
    return np.clip((1 - b) ** 0.55 * np.minimum(1, 0.55 + 3 * b), 0, 1)


def _grass_blade(b: FloatArray) -> FloatArray:
    return np.clip(1 - b, 0, 1) ** 0.7


def _goosefoot_blade(b: FloatArray) -> FloatArray:
    """Rhombic with a few blunt teeth."""
    rhombus = np.minimum(b / 0.35, (1.0 - b) / 0.65)
    return np.clip(rhombus * (1 + 0.22 * np.cos(2 * np.pi * 3.5 * b)), 0, 1.1)


def _thistle_blade(b: FloatArray) -> FloatArray:
    """Lobed almost to the rib."""
    body = np.sin(np.pi * np.clip(b, 0, 1) ** 0.85) ** 0.8
    return body * (0.72 + 0.42 * np.sin(2 * np.pi * 5.0 * b))


def _stem_blade(b: FloatArray) -> FloatArray:
    return np.ones_like(b)


def _leaves(
    rng: np.random.Generator, yaw_rad: FloatArray, *, length: FloatArray, width: FloatArray,
    pitch_deg: FloatArray, curl: tuple[float, float], profile: Profile, petiole: float = 0.0,
    fold: float = 0.25, wave: float = 0.0, twist: float = 0.0, base_z: FloatArray | None = None,
    tone: FloatArray | None = None,
) -> Leaves:  # fmt: skip
    """Leaves with the small irregularities that every species has."""
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


def _stem(rng: np.random.Generator, height: float, width: float) -> Leaves:
    yaw_rad = np.array([0.0, np.pi / 3, 2 * np.pi / 3]) + rng.uniform(0, np.pi)
    ones = np.ones(3)
    stem = _leaves(
        rng, yaw_rad, length=height * ones, width=width * ones, pitch_deg=90.0 * ones,
        curl=(0.0, 0.0), profile=_stem_blade, fold=0.0,
    )  # fmt: skip
    return stem._replace(length=height * ones, pitch_rad=np.pi / 2 * ones, twist_rad=0 * ones)


def _count(rng: np.random.Generator, stage: float, few: int, many: int) -> int:
    return max(2, round(few + (many - few) * stage + rng.uniform(-1.0, 1.0)))


def _spiral(rng: np.random.Generator, count: int) -> FloatArray:
    turn = rng.uniform(0, 2 * np.pi) + rng.choice([-1, 1]) * GOLDEN_ANGLE_RAD * np.arange(count)
    angles: FloatArray = turn + rng.normal(0, 0.2, count)
    return angles


def _sugar_beet(rng: np.random.Generator, stage: float) -> list[Leaves]:
    count = _count(rng, stage, 4, 11)
    age = np.arange(count) / count  # 0 the outer and oldest leaf
    length = (0.62 + 0.38 * stage) * (1 - 0.42 * age)
    return [
        _leaves(rng, _spiral(rng, count), length=length, width=0.4 * length,
                pitch_deg=32 + 44 * age, curl=(0.5, 1.1), profile=_beet_blade, petiole=0.32,
                fold=0.3, wave=0.32, tone=0.9 + 0.2 * age),
    ]  # fmt: skip


def _lettuce(rng: np.random.Generator, stage: float) -> list[Leaves]:
    count = _count(rng, stage, 5, 16)
    age = np.arange(count) / count
    length = 1 - 0.5 * age
    return [
        _leaves(rng, _spiral(rng, count), length=length, width=0.72 * length,
                pitch_deg=24 + 56 * age, curl=(0.2, 0.6), profile=_lettuce_blade, fold=0.35,
                wave=0.35, tone=0.88 + 0.3 * age),
    ]  # fmt: skip


def _maize(rng: np.random.Generator, stage: float) -> list[Leaves]:
    count = _count(rng, stage, 3, 8)
    place = np.arange(count) / count
    stem = 0.2 + 0.5 * stage
    yaw_rad = rng.uniform(0, np.pi) + np.arange(count) % 2 * np.pi + rng.normal(0, 0.25, count)
    length = 1.1 * (1 - 0.5 * np.abs(place - 0.45))
    leaves = _leaves(
        rng, yaw_rad, length=length, width=0.12 * length, pitch_deg=58 + 22 * place,
        curl=(1.2, 2.0), profile=_maize_blade, fold=0.5, twist=0.2, wave=0.15,
        base_z=stem * place * 0.9,
    )  # fmt: skip
    return [leaves, _stem(rng, stem, 0.05)]


def _grass(rng: np.random.Generator, stage: float) -> list[Leaves]:
    count = _count(rng, stage, 5, 18)
    length = rng.uniform(0.55, 1.1, count)
    return [
        _leaves(rng, rng.uniform(0, 2 * np.pi, count), length=length,
                width=np.full(count, 0.075 - 0.03 * stage), pitch_deg=rng.uniform(35, 82, count),
                curl=(0.3, 1.6), profile=_grass_blade, fold=0.4),
    ]  # fmt: skip


def _goosefoot(rng: np.random.Generator, stage: float) -> list[Leaves]:
    count = _count(rng, stage, 4, 16)
    place = (np.arange(count) + 0.5) / count
    stem = 0.35 + 0.5 * stage
    length = 0.62 * (1 - 0.55 * place) * (1.25 - 0.35 * stage)
    leaves = _leaves(
        rng, _spiral(rng, count), length=length, width=0.62 * length, pitch_deg=18 + 45 * place**2,
        curl=(0.2, 0.8), profile=_goosefoot_blade, petiole=0.28, fold=0.15, wave=0.1,
        base_z=stem * (0.12 + 0.86 * place), tone=0.9 + 0.22 * place,
    )  # fmt: skip
    return [leaves, _stem(rng, stem, 0.028)]


def _amaranth(rng: np.random.Generator, stage: float) -> list[Leaves]:
    count = _count(rng, stage, 4, 14)
    place = (np.arange(count) + 0.5) / count
    stem = 0.25 + 0.5 * stage
    length = 0.75 * (1 - 0.5 * place) * (1.2 - 0.3 * stage)
    leaves = _leaves(
        rng, _spiral(rng, count), length=length, width=0.42 * length, pitch_deg=25 + 35 * place,
        curl=(0.3, 0.9), profile=_ovate_blade, petiole=0.4, fold=0.25,
        base_z=stem * (0.2 + 0.8 * place**0.7), tone=0.88 + 0.22 * place,
    )  # fmt: skip
    return [leaves, _stem(rng, stem, 0.035)]


def _thistle(rng: np.random.Generator, stage: float) -> list[Leaves]:
    count = _count(rng, stage, 4, 12)
    age = np.arange(count) / count
    length = (0.7 + 0.3 * stage) * (1 - 0.4 * age)
    return [
        _leaves(rng, _spiral(rng, count), length=length, width=0.34 * length,
                pitch_deg=26 + 40 * age, curl=(0.1, 0.6), profile=_thistle_blade, fold=0.2,
                wave=0.45, tone=0.9 + 0.2 * age),
    ]  # fmt: skip


_ALL = (
    Species("sugar_beet", PlantClass.CROP, 0.25, _sugar_beet, 7, (76, 128, 50), (150, 184, 112),
            (150, 172, 104), 8, 0.10, 0),
    Species("maize", PlantClass.CROP, 0.60, _maize, 7, (82, 138, 52), (142, 178, 104),
            (112, 152, 78), 0, 0.08, 1),
    Species("lettuce", PlantClass.CROP, 0.18, _lettuce, 6, (112, 158, 66), (176, 200, 132),
            (168, 192, 124), 7, 0.12, 2),
    Species("grass", PlantClass.WEED, 0.15, _grass, 4, (94, 138, 55), (124, 162, 84),
            (122, 130, 78), 0, 0.10, 3),
    Species("goosefoot", PlantClass.WEED, 0.15, _goosefoot, 8, (86, 131, 66), (140, 172, 114),
            (126, 146, 96), 5, 0.14, 4),
    Species("thistle", PlantClass.WEED, 0.15, _thistle, 16, (82, 127, 62), (148, 174, 116),
            (134, 150, 104), 6, 0.12, 5),
    Species("amaranth", PlantClass.WEED, 0.15, _amaranth, 6, (80, 122, 54), (132, 150, 98),
            (148, 96, 82), 9, 0.12, 6),
)  # fmt: skip
SPECIES: dict[str, Species] = {kind.name: kind for kind in _ALL}


def species_named(name: str) -> Species:
    found = SPECIES.get(name)
    if found is None:
        known = ", ".join(SPECIES)
        raise DescriptionError(f"unknown plant species '{name}'; use one of: {known}")
    return found


def _level(kinds: list[Leaves], segments: int, lod: int) -> Mesh:
    if lod < 2:
        pieces = segments if lod == 0 else max(3, (segments + 1) // 2)
        return merged(
            [leaf_strips(kind, pieces if kind.profile is not _stem_blade else 1) for kind in kinds]
        )
    if lod == 2:
        return merged([leaf_rhombi(kind, 1.1, folded=True) for kind in kinds])
    if lod == 3:
        return leaf_rhombi(kinds[0], 1.2)
    return leaf_triangles(_every_other(kinds[0]), 2.2)


def _every_other(leaves: Leaves) -> Leaves:
    """Half of the leaves, spread over the plant."""
    thinned = {name: getattr(leaves, name)[::2] for name in Leaves._fields[:-2]}
    return leaves._replace(**thinned)


def _with_occlusion(mesh: Mesh) -> Mesh:
    """Darken what lies low and inside, where neighbouring leaves hide the sky."""
    outward = np.hypot(mesh.vertices_m[:, 0], mesh.vertices_m[:, 1])
    outward = outward / max(float(outward.max()), 1e-6)
    openness = np.clip(0.15 + 0.9 * mesh.vertices_m[:, 2] + 0.35 * outward, 0.0, 1.0)
    return mesh._replace(tone=(mesh.tone * (0.58 + 0.42 * openness)).astype(np.float32))


@lru_cache(maxsize=2048)
def plant_lods(species: str, seed_variant: int, stage: float) -> tuple[Mesh, ...]:
    """All levels of detail of one plant of unit height, finest first."""
    kind = species_named(species)
    rng = np.random.default_rng([kind.cell, seed_variant, round(stage * 1000)])
    leaves = kind.habit(rng, stage)
    levels = [_level(leaves, kind.segments, lod) for lod in range(LODS)]
    factor = 1.0 / levels[0].height_m
    return tuple(_with_occlusion(level.scaled(factor)) for level in levels)


def plant_mesh(species: str, seed_variant: int, lod: int, stage: float) -> Mesh:
    """A plant of unit height; multiply the vertices by its size.

    Raises: DescriptionError: the species is unknown.
    """
    return plant_lods(species, seed_variant, stage)[lod]


def nearest_stage(species: str, size_m: float) -> float:
    """The modelled growth stage of a plant of this height."""
    grown = size_m / species_named(species).nominal_size_m
    return min(STAGES, key=lambda stage: abs(stage - grown))
