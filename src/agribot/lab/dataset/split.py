"""Split into training, validation and test sets that share no field, no day and no file."""

from __future__ import annotations

import hashlib
import math
import re
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import msgspec
import numpy as np

from agribot.core.errors import ConfigError
from agribot.lab.dataset.layouts import Layout
from agribot.lab.dataset.records import ABOUT, image_name, read_recipe, read_records

PARTS = ("train", "val", "test")
DAY = re.compile(r"(?<!\d)(?:20)?(\d\d)([-_]?)([01]\d)\2([0-3]\d)(?!\d)")


class Proof(msgspec.Struct, frozen=True, kw_only=True):
    """Proof of the finished split: every list of leaks is empty in a good one."""

    images_total: int
    images_in_no_part: tuple[str, ...]
    images_in_two_parts: tuple[str, ...]
    groups_in_two_parts: tuple[str, ...]
    equal_files_in_two_parts: tuple[tuple[str, str], ...]
    groups_stay_together: bool  # false where single images were the groups: neighbours may leak

    @property
    def ok(self) -> bool:
        return not (
            self.images_in_no_part
            or self.images_in_two_parts
            or self.groups_in_two_parts
            or self.equal_files_in_two_parts
        )


class Split(msgspec.Struct, frozen=True, kw_only=True):
    """Paths of images, relative to the folder, and the groups that each part consists of."""

    by: str
    seed: int
    ratios: dict[str, float]
    reached: dict[str, float]
    groups: dict[str, tuple[str, ...]]
    train: tuple[str, ...]
    val: tuple[str, ...]
    test: tuple[str, ...]
    proof: Proof


def split(layout: Layout, by: str, ratios: Sequence[float], seed: int) -> Split:
    """Give whole groups to the parts so that their shares of images come near the ratios.

    `by` is "field", "day" or "image". Only images that have a mask take part.

    Raises: ConfigError: the groups are unknown or fewer than the parts that want images.
    """
    group_of = _group_images(layout, by)
    members = defaultdict[str, list[str]](list)
    for image, group in group_of.items():
        members[group].append(image)
    wanted = {part: ratio / sum(ratios) for part, ratio in zip(PARTS, ratios, strict=True)}
    part_of = assign({group: len(images) for group, images in members.items()}, wanted, seed, by)
    images = {
        part: tuple(sorted(image for image, group in group_of.items() if part_of[group] == part))
        for part in PARTS
    }
    groups = {part: tuple(sorted(g for g in part_of if part_of[g] == part)) for part in PARTS}
    return Split(
        by=by,
        seed=seed,
        ratios=wanted,
        reached={part: len(images[part]) / len(group_of) for part in PARTS},
        groups=groups,
        **images,
        proof=prove(layout.root, images, group_of, by),
    )


def assign(
    sizes: Mapping[str, int], wanted: Mapping[str, float], seed: int, by: str
) -> dict[str, str]:
    """Choose the part of each group: big ones first, each to where most images are missing.

    Raises: ConfigError: fewer groups than parts.
    """
    total = sum(sizes.values())
    missing = {part: ratio * total for part, ratio in wanted.items() if ratio > 0.0}
    if len(sizes) < len(missing):
        raise ConfigError(
            f"--by {by} finds {len(sizes)} group(s), fewer than the {len(missing)} parts that want "
            "images; use fewer parts (such as --ratios 80,20,0), a finer --by, or --by image, "
            "which cannot keep neighbouring pictures apart"
        )
    order = np.random.default_rng(seed).permutation(sorted(sizes)).tolist()
    order.sort(key=lambda group: -sizes[group])  # stable: equal sizes stay shuffled
    empty, part_of = set(missing), dict[str, str]()
    for done, group in enumerate(order):
        choice = empty if len(order) - done <= len(empty) else missing.keys()
        part = max((p for p in missing if p in choice), key=lambda p: missing[p])
        part_of[group] = part
        missing[part] -= sizes[group]
        empty.discard(part)
    return part_of


def prove(
    root: Path, images: Mapping[str, Sequence[str]], group_of: Mapping[str, str], by: str
) -> Proof:
    """Search a split for leaks, in its lists and in the bytes of its files."""
    parts_of_image = _index_places((part, name) for part in PARTS for name in images[part])
    parts_of_group = _index_places((p, group_of[name]) for p in PARTS for name in images[p])
    seen: dict[str, tuple[str, str]] = {}
    equal = []
    for part in PARTS:
        for name in images[part]:
            digest = hashlib.sha256((root / name).read_bytes()).hexdigest()
            other_part, other = seen.setdefault(digest, (part, name))
            if other_part != part:
                equal.append((other, name))
    return Proof(
        images_total=len(group_of),
        images_in_no_part=tuple(sorted(group_of.keys() - parts_of_image.keys())),
        images_in_two_parts=tuple(n for n, parts in parts_of_image.items() if len(parts) > 1),
        groups_in_two_parts=tuple(g for g, parts in parts_of_group.items() if len(parts) > 1),
        equal_files_in_two_parts=tuple(equal),
        groups_stay_together=by != "image",
    )


def read_ratios(text: str) -> tuple[float, ...]:
    """Read three shares of training, validation and test, of any sum.

    Raises: ConfigError: not three numbers >= 0 with at least one above 0.
    """
    try:
        ratios = tuple(float(word) for word in text.split(","))
    except ValueError:
        ratios = ()
    if len(ratios) != 3 or not all(0.0 <= r < math.inf for r in ratios) or not sum(ratios):
        raise ConfigError(f"--ratios {text}: not shares; write train, val and test as in 70,15,15")
    return ratios


def _index_places(pairs: Iterable[tuple[str, str]]) -> dict[str, set[str]]:
    places = defaultdict[str, set[str]](set)
    for part, name in pairs:
        places[name].add(part)
    return places


def _group_images(layout: Layout, by: str) -> dict[str, str]:
    """Find the group of every image that has a mask."""
    items = [item for item in layout.items if item.image is not None and item.mask is not None]
    if not items:
        raise ConfigError(f"{layout.root} has no image with a mask; see agribot dataset check")
    fields = _read_fields(layout.root) if by == "field" else {}
    groups = {}
    for item in items:
        image = item.image or ""
        if by == "image":
            groups[image] = image
        elif by == "day":
            groups[image] = _read_day(image)
        else:
            groups[image] = fields.get(image, item.group or "the only field")
    return groups


def _read_fields(root: Path) -> dict[str, str]:
    if not (root / ABOUT).is_file():
        return {}
    recipe = read_recipe(root)
    return {image_name(recipe, r.index): f"field {r.field:06d}" for r in read_records(root)}


def _read_day(image: str) -> str:
    found = DAY.search(image)
    if found is None:
        raise ConfigError(
            f"--by day: {image} has no date such as 160421 or 2016-04-21 in its path; "
            "use --by field"
        )
    year, _, month, day = found.groups()
    return f"20{year}-{month}-{day}"
