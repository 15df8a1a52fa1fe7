"""Check that every image has a mask that fits, and what the masks hold."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

import msgspec
import numpy as np

from agribot.core.messages import PlantClass
from agribot.lab.dataset.analysis import SetAnalysis
from agribot.lab.dataset.classes import (
    ALL_IGNORED,
    UNKNOWN,
    UNLABELLED,
    VALUE_MODES,
    ClassTally,
    MaskIds,
    advise_ids,
    advise_swapped,
    explain_no_classes,
    read_classes,
)
from agribot.lab.dataset.layouts import Item, Layout
from agribot.lab.dataset.pictures import PictureError, open_mask, read_picture
from agribot.lab.dataset.placement import PlacementTally

Read = TypeVar("Read")


class DatasetProblem(msgspec.Struct, frozen=True, kw_only=True):
    kind: str
    file: str
    detail: str = ""


class CheckReport(msgspec.Struct, frozen=True, kw_only=True):
    """The result of a check; `without_plants` counts the masks that are all soil.

    `groups` and `annotated` are the files of each set of a collection, such as a day, and those
    that are image and mask. `pixel_ratio` is over all pixels of known class in readable pairs;
    null without such pixels.
    """

    folder: str
    ok: bool
    images: int
    masks: int
    pairs: int
    groups: dict[str, int]
    annotated: dict[str, int]
    sizes: dict[str, int]
    pixel_ratio: dict[str, float | None]
    without_plants: int
    problems: tuple[DatasetProblem, ...]


class CheckTally:
    """The sums over the checked pairs."""

    def __init__(self, analysis: SetAnalysis | None) -> None:
        self.analysis = analysis
        self.problems: list[DatasetProblem] = []
        self.classes = ClassTally()
        self.placement = PlacementTally()
        self.sizes: Counter[str] = Counter()
        self.pairs = self.without_plants = 0
        self.holds_values = False

    def note(self, kind: str, file: str, detail: str = "") -> None:
        self.problems.append(DatasetProblem(kind=kind, file=file, detail=detail))


def check(
    layout: Layout,
    progress: Callable[[int], None],
    ids: MaskIds | None = None,
    *,
    keeps_misplaced: bool = False,
    analysis: SetAnalysis | None = None,
) -> CheckReport:
    """Open every file of a layout; `progress` gets how many items are done.

    `ids` is the meaning of the values of the masks, and colours are refused; where it is None, the
    usual meaning of values and colours is taken and doubted where the pictures speak against it.
    Pictures whose labels do not lie on their plants are problems, unless `keeps_misplaced`.
    `analysis` counts the readable pairs.
    """
    tally = CheckTally(analysis)
    for reason, name in layout.left_out:
        tally.note(reason, name)
    for done, item in enumerate(layout.items, 1):
        _check_item(layout.root, item, tally, ids or {})
        progress(done)
    for name, reason in {} if keeps_misplaced else tally.placement.misplaced.items():
        tally.note("labels off the plants", name, reason)
    doubt = "" if ids else tally.classes.explain_doubt()
    if doubt:
        advice = advise_swapped(holds_values=tally.holds_values)
        tally.note("classes look swapped", str(layout.root), f"{doubt}; {advice}")
    return CheckReport(
        folder=str(layout.root),
        ok=not tally.problems,
        images=sum(item.image is not None for item in layout.items),
        masks=sum(item.mask is not None for item in layout.items),
        pairs=tally.pairs,
        groups=dict(Counter(item.group for item in layout.items)),
        annotated={
            group: sum(item.image is not None and item.mask is not None for item in items)
            for group, items in _group(layout.items).items()
        },
        sizes=dict(tally.sizes),
        pixel_ratio=tally.classes.ratios(),
        without_plants=tally.without_plants,
        problems=tuple(tally.problems),
    )


def _group(items: Sequence[Item]) -> dict[str, list[Item]]:
    groups: dict[str, list[Item]] = {}
    for item in items:
        groups.setdefault(item.group, []).append(item)
    return groups


def _check_item(root: Path, item: Item, tally: CheckTally, ids: MaskIds) -> None:
    if item.image is None and item.mask is not None:
        tally.note("mask without image", item.mask)
    elif item.mask is None and item.image is not None:
        tally.note("image without mask", item.image)
    if item.image is None or item.mask is None:
        return
    image_rgb = _read(root, item.image, tally, read_picture)
    mask = _read(root, item.mask, tally, open_mask)
    if image_rgb is None or mask is None:
        return
    height, width = image_rgb.shape[:2]
    size = f"{width}x{height}"
    if (width, height) != mask.size:
        tally.note(
            "sizes differ",
            item.image,
            f"image {size}, mask {mask.width}x{mask.height} px: {item.mask}",
        )
        return
    classes = read_classes(mask, ids)
    if classes is None:
        tally.note("no class mask", item.mask, explain_no_classes(mask, is_named=True))
        return
    counts = np.bincount(classes.ravel(), minlength=256)
    if counts[UNLABELLED] == classes.size:
        tally.note("nothing labelled", item.mask, ALL_IGNORED)
        return
    if counts[UNKNOWN]:
        unknown = f"{int(counts[UNKNOWN])} pixels{advise_ids(mask)}"
        tally.note("unknown class", item.mask, unknown)
    tally.holds_values |= mask.mode in VALUE_MODES
    tally.pairs += 1
    tally.sizes[size] += 1
    tally.without_plants += not counts[PlantClass.WEED] + counts[PlantClass.CROP]
    tally.classes.add(image_rgb, classes)
    tally.placement.add(item.image, image_rgb, classes)
    if tally.analysis is not None:
        tally.analysis.add(item, image_rgb, classes)


def _read(root: Path, name: str, tally: CheckTally, read: Callable[[Path], Read]) -> Read | None:
    """Read a file as a training does; one that cannot be read is noted."""
    try:
        return read(root / name)
    except PictureError as error:
        tally.note("unreadable", name, str(error).removeprefix(f"{root / name}: "))
        return None
