"""Plants of compound leaves: fronds with leaflets in pairs, each of them forked into lobes.

The first kind of leaves is the outline of the fronds, which stands for all of them from afar.
Carrot and chamomile look alike where they stand side by side: a carrot's leaflets are short,
broad and close, and its seedling still has two long straps of seed leaves; a chamomile's are
long threads with room between them. The first leaves of a carrot are small fans on stalks; a
young chamomile lies flat on the ground, with ribs as wide as the lobes that fork off them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from agribot.core.messages import FloatArray
from agribot.sim.flora.habit import (
    SEEDLING_STAGE,
    arrange_spiral,
    choose_leaf_count,
    grow_leaves,
    stem_blade,
    strap_blade,
)
from agribot.sim.flora.mesh import Leaves, Profile, find_on_midrib


def _outline_blade(b: FloatArray) -> FloatArray:
    return np.clip(np.minimum(b / 0.25, (1.03 - b) / 0.75), 0.0, 1.0)


def _lobe_blade(b: FloatArray) -> FloatArray:
    """Return the width of a blade that is narrow at its foot and blunt at its end."""
    return np.clip(np.minimum(0.35 + 1.6 * b, (1.02 - b) / 0.35), 0.0, 1.0) ** 0.8


def _finger_blade(b: FloatArray) -> FloatArray:
    """Return the width of a blade that is nearly as wide at its round end as in its middle."""
    return np.clip(np.minimum(0.5 + 1.2 * b, (1.12 - b) / 0.3), 0.0, 1.0)


class _Frond(NamedTuple):
    """Proportions of a frond.

    `leaflet` is a share of the frond's length, `lobe` of the leaflet's, `lobe_width` of the
    lobe's. `fork_rad` is the angle between lobes, `pairs` the number of leaflet pairs, which
    stand `within` these shares of the frond's length; `stagger` shifts those of one side along
    it. `rib_width` is a share of the frond's length, `stalk_width` of the leaflet's. `outline` is
    how much longer than the ribs what is drawn from afar is.
    """

    leaflet: float
    lobe: float
    lobe_width: float
    fork_rad: float
    pairs: int
    lobes: int = 3
    within: tuple[float, float] = (0.45, 0.84)
    stagger: float = 0.0
    rib_width: float = 0.045
    stalk_width: float = 0.16
    lobe_blade: Profile = _lobe_blade
    outline: float = 1.0


def grow_carrot(rng: np.random.Generator, stage: float) -> list[Leaves]:
    if stage <= SEEDLING_STAGE:
        return _grow_carrot_seedling(rng)
    count = choose_leaf_count(rng, stage, 2, 9)
    age = np.arange(count) / count
    length = (0.7 + 0.3 * stage) * (1 - 0.35 * age)
    upright_deg = 36 + 24 * stage + (40 - 16 * stage) * age
    fronds = _grow_fronds(
        rng, age, length=length, width=0.60 * length, pitch_deg=upright_deg, curl=(0.3, 1.0),
        petiole=0.36, twist=0.15,
    )  # fmt: skip
    shape = _Frond(leaflet=0.30, lobe=0.62, lobe_width=0.46, fork_rad=0.66,
                   pairs=2 + round(2 * stage))  # fmt: skip
    kinds = _grow_compound(rng, fronds, shape)
    return [*kinds, _grow_seed_leaves(rng, fronds)] if stage < 0.5 else kinds


def _grow_carrot_seedling(rng: np.random.Generator) -> list[Leaves]:
    """Grow a few leaves, each a fan of blunt lobes like fingers, between the seed leaves."""
    age = np.arange(count := int(rng.integers(2, 7))) / count
    length = 1 - 0.5 * age
    fronds = _grow_fronds(
        rng, age, length=length, width=0.8 * length, pitch_deg=rng.uniform(30, 66) + 24 * age,
        curl=(0.3, 1.2), petiole=0.4, twist=0.25,
    )  # fmt: skip
    foot = rng.uniform(0.25, 0.7)
    shape = _Frond(leaflet=rng.uniform(0.4, 0.75), lobe=rng.uniform(0.6, 0.95),
                   lobe_width=rng.uniform(0.18, 0.40), fork_rad=rng.uniform(0.45, 0.85),
                   pairs=int(rng.integers(1, 3)), lobes=int(rng.choice([3, 5])),
                   within=(foot, max(0.6, foot + 0.1)), stalk_width=0.2,
                   lobe_blade=_finger_blade, outline=1.3)  # fmt: skip
    return [*_grow_compound(rng, fronds, shape), _grow_seed_leaves(rng, fronds, (1.0, 2.0))]


def _grow_chamomile_rosette(rng: np.random.Generator) -> list[Leaves]:
    """Grow leaves that lie flat, like antlers: lobes fork off by turns, as wide as the rib."""
    age = np.arange(count := int(rng.integers(4, 10))) / count
    length = 1 - 0.6 * age
    fronds = _grow_fronds(
        rng, age, length=length, width=0.45 * length, pitch_deg=rng.uniform(6, 24) + 46 * age,
        curl=(0.0, 0.5), petiole=0.25, twist=0.2,
    )  # fmt: skip
    pairs = int(rng.integers(2, 5))
    shape = _Frond(leaflet=rng.uniform(0.24, 0.46), lobe=rng.uniform(0.45, 0.75),
                   lobe_width=rng.uniform(0.18, 0.34), fork_rad=rng.uniform(0.45, 0.75),
                   pairs=pairs, lobes=int(rng.choice([2, 3])), within=(0.36, 0.84),
                   stagger=rng.uniform(0.0, 0.4) / pairs, rib_width=rng.uniform(0.05, 0.1),
                   stalk_width=rng.uniform(0.16, 0.3), lobe_blade=_finger_blade)  # fmt: skip
    return _grow_compound(rng, fronds, shape)


def grow_parsley(rng: np.random.Generator, stage: float) -> list[Leaves]:
    count = choose_leaf_count(rng, stage, 3, 9)
    age = np.arange(count) / count
    length = (0.75 + 0.25 * stage) * (1 - 0.4 * age)
    fronds = _grow_fronds(
        rng, age, length=length, width=length, pitch_deg=24 + 22 * stage + 36 * age,
        curl=(0.2, 0.9), petiole=0.42, twist=0.15,
    )  # fmt: skip
    shape = _Frond(leaflet=rng.uniform(0.36, 0.54), lobe=0.78,
                   lobe_width=rng.uniform(0.45, 0.95), fork_rad=rng.uniform(0.6, 0.95),
                   pairs=int(rng.integers(1, 3)))  # fmt: skip
    return _grow_compound(rng, _widen_outline(fronds, shape), shape)


def grow_chamomile(rng: np.random.Generator, stage: float) -> list[Leaves]:
    if stage <= SEEDLING_STAGE:
        return _grow_chamomile_rosette(rng)
    count = choose_leaf_count(rng, stage, 4, 11)
    age = np.arange(count) / count
    length = (0.75 + 0.25 * stage) * (1 - 0.45 * age)
    fronds = _grow_fronds(
        rng, age, length=length, width=0.40 * length, pitch_deg=22 + 50 * age, curl=(0.0, 0.6),
        petiole=0.3, twist=0.2,
    )  # fmt: skip
    shape = _Frond(leaflet=0.26, lobe=0.66, lobe_width=0.24, fork_rad=0.5,
                   pairs=2 + round(1.5 * stage))  # fmt: skip
    return _grow_compound(rng, fronds, shape)


def grow_mayweed(rng: np.random.Generator, stage: float) -> list[Leaves]:
    """Grow fronds of long threads, finer than those of chamomile."""
    count = choose_leaf_count(rng, stage, 3, 11)
    age = np.arange(count) / count
    length = (0.8 + 0.2 * stage) * (1 - 0.4 * age)
    fronds = _grow_fronds(
        rng, age, length=length, width=length, pitch_deg=16 + 46 * age, curl=(0.0, 0.6),
        petiole=0.25, twist=0.3,
    )  # fmt: skip
    shape = _Frond(leaflet=rng.uniform(0.26, 0.40), lobe=rng.uniform(0.5, 0.75),
                   lobe_width=rng.uniform(0.12, 0.22), fork_rad=rng.uniform(0.4, 0.7),
                   pairs=int(rng.integers(2, 5)))  # fmt: skip
    return _grow_compound(rng, _widen_outline(fronds, shape), shape)


def _grow_fronds(
    rng: np.random.Generator, age: FloatArray, *, length: FloatArray, width: FloatArray,
    pitch_deg: FloatArray, curl: tuple[float, float], petiole: float, twist: float,
) -> Leaves:  # fmt: skip
    """Grow the outline of a frond for each age (n,), 0 the oldest, in a spiral."""
    return grow_leaves(
        rng, arrange_spiral(rng, len(age)), length=length, width=width, pitch_deg=pitch_deg,
        curl=curl, profile=_outline_blade, petiole=petiole, fold=0.1, twist=twist,
        tone=0.9 + 0.2 * age,
    )  # fmt: skip


def _widen_outline(fronds: Leaves, shape: _Frond) -> Leaves:
    """Make outlines of any width half as large as the stalks and lobes of their fronds."""
    lobes = (2 * shape.pairs + 1) * (shape.leaflet * shape.lobe) ** 2 * shape.lobe_width
    return fronds._replace(width=(0.15 + 3.2 * lobes) * fronds.length)


def _stretch_outline(fronds: Leaves, ratio: float) -> Leaves:
    """Make outlines reach to the ends of lobes that are long beside their fronds."""
    return fronds._replace(length=ratio * fronds.length, width=ratio * fronds.width)


def _grow_compound(rng: np.random.Generator, fronds: Leaves, shape: _Frond) -> list[Leaves]:
    ribs = fronds._replace(width=shape.rib_width * fronds.length, petiole=0.0, profile=stem_blade)
    tips = shape.lobe * shape.leaflet * fronds.length
    kinds = [
        _stretch_outline(fronds, shape.outline),
        ribs,
        *_grow_lobes(rng, ribs, shape, 0.94, tips),
    ]
    for along in np.linspace(*shape.within, shape.pairs):
        for side in (-1.0, 1.0):
            place = float(along + 0.5 * side * shape.stagger + rng.normal(0.0, 0.015))
            kinds += _grow_leaflets(rng, fronds, shape, place, side)
    return kinds


def _grow_leaflets(
    rng: np.random.Generator, fronds: Leaves, shape: _Frond, along: float, side: float
) -> list[Leaves]:
    """Grow a leaflet on each frond at a share of its length, shorter towards the tip."""
    base, rise_rad = find_on_midrib(fronds, along)
    count = len(base)
    length = shape.leaflet * (1.3 - 0.6 * along) * fronds.length * rng.uniform(0.7, 1.2, count)
    stalks = grow_leaves(
        rng, fronds.yaw_rad + side * rng.uniform(0.6, 1.05, count), length=length,
        width=shape.stalk_width * length, pitch_deg=np.degrees(0.8 * rise_rad), curl=(0.0, 0.5),
        profile=stem_blade, fold=0.2, tone=fronds.tone,
    )  # fmt: skip
    stalks = stalks._replace(base=base)
    return [stalks, *_grow_lobes(rng, stalks, shape, 0.55, shape.lobe * length)]


def _grow_lobes(
    rng: np.random.Generator, carriers: Leaves, shape: _Frond, along: float, length: FloatArray
) -> list[Leaves]:
    """Grow lobes at the end of each carrier: one goes on, the others fork off before it."""
    lobes = []
    for turn in np.linspace(-1.0, 1.0, shape.lobes):
        base, rise_rad = find_on_midrib(carriers, along if turn else min(1.0, along + 0.3))
        own = length * rng.uniform(0.8, 1.2, len(base)) * (0.85 if turn else 1.0)
        yaw_rad = carriers.yaw_rad + turn * shape.fork_rad * rng.uniform(0.8, 1.2, len(base))
        lobe = grow_leaves(
            rng, yaw_rad, length=own, width=shape.lobe_width * own,
            pitch_deg=np.degrees(rise_rad), curl=(0.0, 0.5), profile=shape.lobe_blade, fold=0.2,
            tone=carriers.tone,
        )  # fmt: skip
        lobes.append(lobe._replace(base=base))
    return lobes


def _grow_seed_leaves(
    rng: np.random.Generator, fronds: Leaves, ratio: tuple[float, float] = (0.9, 1.4)
) -> Leaves:
    """Grow two straps, as long as the longest frond times a number within `ratio`."""
    yaw_rad = fronds.yaw_rad[0] + np.pi / 2 + np.array([0.0, np.pi]) + rng.normal(0.0, 0.3, 2)
    length = float(fronds.length.max()) * rng.uniform(*ratio, 2)
    return grow_leaves(
        rng, yaw_rad, length=length, width=0.11 * length, pitch_deg=rng.uniform(8.0, 30.0, 2),
        curl=(0.0, 0.7), profile=strap_blade, petiole=0.15, fold=0.15, tone=np.full(2, 0.92),
    )  # fmt: skip
