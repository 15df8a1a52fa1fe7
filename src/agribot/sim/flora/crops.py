"""Crops: leaves as functions of a random generator and a growth stage in (0, 1].

A `_blade` is the width of a leaf along its blade: `b` (...,) from 0 at the base to 1 at the tip.

Habits follow the look of the seedlings and rosettes of the real species; no scan or photograph
is part of them.
"""

from __future__ import annotations

import numpy as np

from agribot.core.messages import FloatArray
from agribot.sim.flora.habit import arrange_spiral, choose_leaf_count, grow_leaves, grow_stalk
from agribot.sim.flora.mesh import Leaves


def _beet_blade(b: FloatArray) -> FloatArray:
    return np.sin(np.pi * np.clip(b, 0, 1) ** 0.8) ** 0.7


def _lettuce_blade(b: FloatArray) -> FloatArray:
    return np.clip(0.25 + 1.5 * b, 0, 1) * np.clip(6.0 * (1.02 - b), 0, 1) ** 0.5


def _maize_blade(b: FloatArray) -> FloatArray:
    return np.clip((1 - b) ** 0.55 * np.minimum(1, 0.55 + 3 * b), 0, 1)


def _onion_blade(b: FloatArray) -> FloatArray:
    """Return the width of a tube that narrows to its tip."""
    return np.clip(0.8 + 0.5 * b, 0, 1) * np.clip(2.2 * (1.02 - b), 0, 1) ** 0.8


def grow_sugar_beet(rng: np.random.Generator, stage: float) -> list[Leaves]:
    count = choose_leaf_count(rng, stage, 4, 11)
    age = np.arange(count) / count  # 0 the outer and oldest leaf
    length = (0.62 + 0.38 * stage) * (1 - 0.42 * age)
    return [
        grow_leaves(rng, arrange_spiral(rng, count), length=length, width=0.4 * length,
                pitch_deg=32 + 44 * age, curl=(0.5, 1.1), profile=_beet_blade, petiole=0.32,
                fold=0.3, wave=0.32, tone=0.9 + 0.2 * age),
    ]  # fmt: skip


def grow_lettuce(rng: np.random.Generator, stage: float) -> list[Leaves]:
    count = choose_leaf_count(rng, stage, 5, 16)
    age = np.arange(count) / count
    length = 1 - 0.5 * age
    return [
        grow_leaves(rng, arrange_spiral(rng, count), length=length, width=0.72 * length,
                pitch_deg=24 + 56 * age, curl=(0.2, 0.6), profile=_lettuce_blade, fold=0.35,
                wave=0.35, tone=0.88 + 0.3 * age),
    ]  # fmt: skip


def grow_maize(rng: np.random.Generator, stage: float) -> list[Leaves]:
    count = choose_leaf_count(rng, stage, 3, 8)
    place = np.arange(count) / count
    stem = 0.2 + 0.5 * stage
    yaw_rad = rng.uniform(0, np.pi) + np.arange(count) % 2 * np.pi + rng.normal(0, 0.25, count)
    length = 1.1 * (1 - 0.5 * np.abs(place - 0.45))
    blades = grow_leaves(
        rng, yaw_rad, length=length, width=0.12 * length, pitch_deg=58 + 22 * place,
        curl=(1.2, 2.0), profile=_maize_blade, fold=0.5, twist=0.2, wave=0.15,
        base_z=stem * place * 0.9,
    )  # fmt: skip
    return [blades, grow_stalk(rng, stem, 0.05)]


def grow_onion(rng: np.random.Generator, stage: float) -> list[Leaves]:
    count = choose_leaf_count(rng, stage, 2, 6)
    age = np.arange(count) / count
    # Two ranks, as the leaves of onion and leek stand; the youngest upright in the middle.
    ranks = rng.uniform(0, np.pi) + np.arange(count) % 2 * np.pi + rng.normal(0, 0.3, count)
    length = 1.0 - 0.3 * np.abs(age - 0.35)
    return [
        grow_leaves(rng, ranks, length=length, width=np.full(count, 0.075 - 0.02 * stage),
               pitch_deg=66 + 20 * age, curl=(0.0, 0.45), profile=_onion_blade, fold=0.9,
               base_z=0.06 * age, tone=0.92 + 0.16 * age),
    ]  # fmt: skip


def grow_fodder_beet(rng: np.random.Generator, stage: float) -> list[Leaves]:
    """Grow long-stalked leaves with wavy blades that stand upright and hang over at their tips."""
    count = choose_leaf_count(rng, stage, 4, 13)
    age = np.arange(count) / count  # 0 the outer and oldest leaf
    length = (0.66 + 0.34 * stage) * (1 - 0.32 * age)
    return [
        grow_leaves(rng, arrange_spiral(rng, count), length=length, width=0.36 * length,
                pitch_deg=46 + 34 * age, curl=(0.4, 1.7), profile=_beet_blade, petiole=0.38,
                fold=0.4, twist=0.25, wave=0.6, tone=0.86 + 0.26 * age),
    ]  # fmt: skip
