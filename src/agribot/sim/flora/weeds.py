"""Weeds: leaves as functions of a random generator and a growth stage in (0, 1].

A `_blade` is the width of a leaf along its blade: `b` (...,) from 0 at the base to 1 at the tip.

Habits follow the look of the seedlings and rosettes of the real species; no scan or photograph
is part of them.
"""

from __future__ import annotations

import numpy as np

from agribot.core.messages import FloatArray
from agribot.sim.flora.habit import (
    SEEDLING_STAGE,
    arrange_spiral,
    choose_leaf_count,
    grow_leaves,
    grow_stalk,
    stem_blade,
)
from agribot.sim.flora.mesh import Leaves


def _ovate_blade(b: FloatArray) -> FloatArray:
    return np.sin(np.pi * np.clip(b, 0, 1) ** 0.72) ** 0.85


def _grass_blade(b: FloatArray) -> FloatArray:
    return np.clip(1 - b, 0, 1) ** 0.7


def _goosefoot_blade(b: FloatArray) -> FloatArray:
    """Return the width of a rhombus with a few blunt teeth."""
    rhombus = np.minimum(b / 0.35, (1.0 - b) / 0.65)
    return np.clip(rhombus * (1 + 0.22 * np.cos(2 * np.pi * 3.5 * b)), 0, 1.1)


def _thistle_blade(b: FloatArray) -> FloatArray:
    """Return the width of a blade that is lobed almost to the rib."""
    body = np.sin(np.pi * np.clip(b, 0, 1) ** 0.85) ** 0.8
    return body * (0.72 + 0.42 * np.sin(2 * np.pi * 5.0 * b))


def _plantain_blade(b: FloatArray) -> FloatArray:
    return np.sin(np.pi * np.clip(b, 0, 1) ** 0.85) ** 0.6


def _charlock_blade(b: FloatArray) -> FloatArray:
    """Return the width of a lyrate blade: a broad end lobe, small ones along the rib."""
    lobes = 0.30 + 0.16 * np.cos(2 * np.pi * 4.0 * b)
    return np.where(b < 0.45, lobes, np.sin(np.pi * np.clip((b - 0.36) / 0.64, 0, 1)) ** 0.7)


def _millet_blade(b: FloatArray) -> FloatArray:
    """Return the width of a blade that is broad from its foot on and runs out into its tip."""
    return np.clip(np.minimum(0.6 + 2.0 * b, (1.0 - b) / 0.65), 0.0, 1.0) ** 0.8


def _knotweed_blade(b: FloatArray) -> FloatArray:
    return np.sin(np.pi * np.clip(b, 0, 1) ** 0.9) ** 0.75


def _milk_thistle_blade(b: FloatArray) -> FloatArray:
    """Return the width of a broad blade with shallow lobes."""
    body = np.sin(np.pi * np.clip(b, 0, 1) ** 0.95) ** 0.6
    return body * (0.88 + 0.14 * np.sin(2 * np.pi * 4.0 * b))


def grow_grass(rng: np.random.Generator, stage: float) -> list[Leaves]:
    count = choose_leaf_count(rng, stage, 5, 18)
    length = rng.uniform(0.55, 1.1, count)
    return [
        grow_leaves(rng, rng.uniform(0, 2 * np.pi, count), length=length,
                width=np.full(count, 0.075 - 0.03 * stage), pitch_deg=rng.uniform(35, 82, count),
                curl=(0.3, 1.6), profile=_grass_blade, fold=0.4),
    ]  # fmt: skip


def grow_goosefoot(rng: np.random.Generator, stage: float) -> list[Leaves]:
    count = choose_leaf_count(rng, stage, 4, 16)
    place = (np.arange(count) + 0.5) / count
    stem = 0.35 + 0.5 * stage
    length = 0.62 * (1 - 0.55 * place) * (1.25 - 0.35 * stage)
    blades = grow_leaves(
        rng, arrange_spiral(rng, count), length=length, width=0.62 * length,
        pitch_deg=18 + 45 * place**2,
        curl=(0.2, 0.8), profile=_goosefoot_blade, petiole=0.28, fold=0.15, wave=0.1,
        base_z=stem * (0.12 + 0.86 * place), tone=0.9 + 0.22 * place,
    )  # fmt: skip
    return [blades, grow_stalk(rng, stem, 0.028)]


def grow_amaranth(rng: np.random.Generator, stage: float) -> list[Leaves]:
    count = choose_leaf_count(rng, stage, 4, 14)
    place = (np.arange(count) + 0.5) / count
    stem = 0.25 + 0.5 * stage
    length = 0.75 * (1 - 0.5 * place) * (1.2 - 0.3 * stage)
    blades = grow_leaves(
        rng, arrange_spiral(rng, count), length=length, width=0.42 * length,
        pitch_deg=25 + 35 * place,
        curl=(0.3, 0.9), profile=_ovate_blade, petiole=0.4, fold=0.25,
        base_z=stem * (0.2 + 0.8 * place**0.7), tone=0.88 + 0.22 * place,
    )  # fmt: skip
    return [blades, grow_stalk(rng, stem, 0.035)]


def grow_thistle(rng: np.random.Generator, stage: float) -> list[Leaves]:
    count = choose_leaf_count(rng, stage, 4, 12)
    age = np.arange(count) / count
    length = (0.7 + 0.3 * stage) * (1 - 0.4 * age)
    return [
        grow_leaves(rng, arrange_spiral(rng, count), length=length, width=0.34 * length,
                pitch_deg=26 + 40 * age, curl=(0.1, 0.6), profile=_thistle_blade, fold=0.2,
                wave=0.45, tone=0.9 + 0.2 * age),
    ]  # fmt: skip


def grow_chickweed(rng: np.random.Generator, stage: float) -> list[Leaves]:
    """Grow a mat: pairs of small leaves along stems that lie down and rise at their ends."""
    branches = choose_leaf_count(rng, stage, 2, 5)
    nodes = 2 if stage > 0.4 else 1
    branch, node, side = (
        index.ravel() for index in np.mgrid[0:branches, 0:nodes, 0:2].astype(float)
    )
    out = (node + 1.0) / nodes * (0.5 + 0.6 * stage) * rng.uniform(0.8, 1.2, len(branch))
    along = rng.uniform(0, 2 * np.pi) + branch * 2 * np.pi / branches + 0.25 * node
    blades = grow_leaves(
        rng, along + (side - 0.5) * 2.2, length=np.full(len(branch), 0.62),
        width=np.full(len(branch), 0.34), pitch_deg=24 + 22 * node, curl=(0.1, 0.6),
        profile=_ovate_blade, petiole=0.2, fold=0.2, base_z=0.12 + 0.34 * node,
        tone=0.9 + 0.14 * node,
    )  # fmt: skip
    base = blades.base.copy()
    base[:, 0], base[:, 1] = out * np.cos(along), out * np.sin(along)
    reach = np.linspace(0, 2 * np.pi, branches, endpoint=False) + along[0]
    stems = grow_leaves(
        rng, reach, length=np.full(branches, 0.6 + 0.6 * stage), width=np.full(branches, 0.05),
        pitch_deg=np.full(branches, 18.0), curl=(-0.3, 0.2), profile=_plantain_blade, fold=0.1,
    )  # fmt: skip
    return [blades._replace(base=base), stems]


def grow_plantain(rng: np.random.Generator, stage: float) -> list[Leaves]:
    """Grow a flat rosette of broad leaves with parallel veins."""
    count = choose_leaf_count(rng, stage, 3, 10)
    age = np.arange(count) / count
    length = (0.75 + 0.25 * stage) * (1 - 0.4 * age)
    return [
        grow_leaves(rng, arrange_spiral(rng, count), length=length, width=0.52 * length,
               pitch_deg=16 + 36 * age, curl=(0.0, 0.5), profile=_plantain_blade, petiole=0.24,
               fold=0.22, wave=0.12, tone=0.88 + 0.24 * age),
    ]  # fmt: skip


def grow_charlock(rng: np.random.Generator, stage: float) -> list[Leaves]:
    count = choose_leaf_count(rng, stage, 3, 10)
    place = (np.arange(count) + 0.5) / count
    stem = 0.12 + 0.5 * stage
    length = 0.85 * (1 - 0.45 * place) * (1.2 - 0.25 * stage)
    blades = grow_leaves(
        rng, arrange_spiral(rng, count), length=length, width=0.5 * length,
        pitch_deg=26 + 34 * place,
        curl=(0.3, 0.9), profile=_charlock_blade, petiole=0.22, fold=0.25, wave=0.3,
        base_z=stem * 0.9 * place, tone=0.9 + 0.2 * place,
    )  # fmt: skip
    return [blades, grow_stalk(rng, stem, 0.04)]


def grow_millet(rng: np.random.Generator, stage: float) -> list[Leaves]:
    """Grow a grass of few broad straps in two ranks, which arch down to the ground."""
    count = choose_leaf_count(rng, stage, 3, 8)
    place = np.arange(count) / count
    ranks = rng.uniform(0, np.pi) + np.arange(count) % 2 * np.pi + rng.normal(0, 0.45, count)
    length = rng.uniform(0.85, 1.2, count) * (1 - 0.25 * place)
    return [
        grow_leaves(rng, ranks, length=length, width=(0.14 - 0.05 * stage) * length,
               pitch_deg=36 + 30 * place, curl=(0.6, 1.5), profile=_millet_blade, fold=0.5,
               twist=0.5, base_z=(0.05 + 0.25 * stage) * place, tone=0.9 + 0.2 * place),
    ]  # fmt: skip


def grow_knotweed(rng: np.random.Generator, stage: float) -> list[Leaves]:
    """Grow long narrow leaves, the two seed leaves of a seedling the longest.

    Half of the seedlings lie on the ground already, with leaves by turns along their stems.
    """
    if stage <= SEEDLING_STAGE and rng.random() < 0.5:
        return _grow_creeping_stems(rng)
    count = choose_leaf_count(rng, stage, 3, 12)
    place = np.arange(count) / count
    length = 1.0 - 0.5 * place
    return [
        grow_leaves(rng, _arrange_pairs(rng, count), length=length,
               width=rng.uniform(0.17, 0.30) * length, pitch_deg=14 + 36 * place,
               curl=(0.0, 0.5), profile=_knotweed_blade, petiole=0.12, fold=0.2,
               base_z=0.4 * stage * place, tone=0.9 + 0.2 * place),
    ]  # fmt: skip


def _grow_creeping_stems(rng: np.random.Generator) -> list[Leaves]:
    """Grow one to four stems that lie on the ground, with narrow leaves by turns."""
    branches, nodes = int(rng.integers(1, 5)), int(rng.integers(2, 6))
    branch, node = (index.ravel() for index in np.mgrid[0:branches, 0:nodes].astype(float))
    reach = rng.uniform(0, 2 * np.pi) + np.arange(branches) * 2 * np.pi / branches
    reach = reach + rng.normal(0.0, 0.4, branches)
    out = (node + rng.uniform(0.6, 1.0, len(node))) / nodes
    side = np.where(node % 2, 1.0, -1.0) * rng.uniform(0.4, 1.0, len(node))
    along = reach[branch.astype(int)]
    length = rng.uniform(0.30, 0.60) * rng.uniform(0.7, 1.2, len(node))
    pitch_deg = rng.uniform(5, 40, len(node))
    pitch_deg[0] = pitch_deg.max()  # one leaf of half of them is as high as any
    blades = grow_leaves(
        rng, along + side, length=length, width=rng.uniform(0.16, 0.32) * length,
        pitch_deg=pitch_deg, curl=(0.0, 0.6), profile=_knotweed_blade,
        petiole=0.1, fold=0.2, base_z=0.04 + 0.1 * out, tone=0.9 + 0.2 * out,
    )  # fmt: skip
    base = blades.base.copy()
    base[:, 0], base[:, 1] = out * np.cos(along), out * np.sin(along)
    stems = grow_leaves(
        rng, reach, length=np.ones(branches), width=np.full(branches, 0.035),
        pitch_deg=np.full(branches, 6.0), curl=(0.0, 0.0), profile=stem_blade, fold=0.1,
    )  # fmt: skip
    return [blades._replace(base=base), stems._replace(twist_rad=0.0 * reach)]


def grow_quickweed(rng: np.random.Generator, stage: float) -> list[Leaves]:
    """Grow crossed pairs of egg-shaped or round leaves, each pair above the last."""
    count = 2 * choose_leaf_count(rng, stage, 2, 5)
    pair = np.arange(count) // 2 / (count // 2)
    length = np.where(pair == 0, 0.75, 1.0) * (1 - 0.35 * pair) * rng.uniform(0.9, 1.1, count)
    return [
        grow_leaves(rng, _arrange_pairs(rng, count), length=length,
               width=rng.uniform(0.5, 0.95) * length, pitch_deg=14 + 34 * pair,
               curl=(0.0, 0.6), profile=_ovate_blade, petiole=0.26, fold=0.2, wave=0.08,
               base_z=(0.2 + 0.4 * stage) * pair, tone=0.88 + 0.24 * pair),
    ]  # fmt: skip


def grow_milk_thistle(rng: np.random.Generator, stage: float) -> list[Leaves]:
    """Grow a rosette of broad leaves, whose veins are white."""
    count = choose_leaf_count(rng, stage, 3, 8)
    age = np.arange(count) / count
    length = 1 - 0.45 * age
    return [
        grow_leaves(rng, arrange_spiral(rng, count), length=length, width=0.46 * length,
               pitch_deg=18 + 40 * age, curl=(0.1, 0.6), profile=_milk_thistle_blade, fold=0.2,
               wave=0.35, tone=0.9 + 0.2 * age),
    ]  # fmt: skip


def _arrange_pairs(rng: np.random.Generator, count: int) -> FloatArray:
    """Return the yaws of leaves (count,), two opposite each other and the next across, rad."""
    index = np.arange(count)
    across = index // 2 * (np.pi / 2) + index % 2 * np.pi
    angles: FloatArray = rng.uniform(0, 2 * np.pi) + across + rng.normal(0, 0.2, count)
    return angles
