"""Folders of photographs and masks as training and test data."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

import msgspec

from agribot.core.errors import ConfigError
from agribot.core.messages import ByteArray, PlantClass
from agribot.lab.dataset.classes import (
    ALL_IGNORED,
    UNKNOWN,
    UNLABELLED,
    USUAL_COLOURS,
    VALUE_MODES,
    ClassTally,
    MaskIds,
    advise_ids,
    advise_swapped,
    explain_no_classes,
    format_key,
    read_classes,
)
from agribot.lab.dataset.colour_tables import find_table_ids
from agribot.lab.dataset.layouts import (
    ADVICE,
    BONN_MASKS,
    IMAGE_FOLDERS,
    MASK_FOLDERS,
    Item,
    find_layout,
)
from agribot.lab.dataset.pictures import PictureError, open_mask, read_picture

NON_COMMERCIAL = "non-commercial research use only"
ROW_LABELS = "labels"  # folder of drawings of crop rows, in a set of the kind "rows"
SAMPLE_PAIRS = 24  # pairs read before a set is judged; all are read before one is learnt from


class DataKind(msgspec.Struct, frozen=True, kw_only=True):
    """A known data set: its files, the meaning of its mask values, its conditions.

    `ids` maps stored values to classes; empty: ids as in `PlantClass`, or red, green, black.
    """

    about: str
    images: tuple[str, ...] = IMAGE_FOLDERS
    masks: tuple[str, ...] = MASK_FOLDERS
    ids: MaskIds = {}
    license: str = "that of your images"


KINDS = {
    "cwfid": DataKind(
        about="Crop/Weed Field Image Dataset (Haug and Ostermann, ECCV 2014 Workshops)",
        images=("images",),
        masks=("annotations",),
        license=NON_COMMERCIAL,
    ),
    "bonn": DataKind(
        about="Sugar Beets 2016, University of Bonn (Chebrolu et al., IJRR 2017)",
        images=("images/rgb",),
        masks=BONN_MASKS,
        license=NON_COMMERCIAL,
    ),
    "phenobench": DataKind(
        about="PhenoBench (Weyler et al., TPAMI 2024)",
        images=("images",),
        masks=("semantics",),
        # Parts of plants that the image edge cuts (3, 4) are plants all the same.
        ids={
            0: PlantClass.SOIL,
            1: PlantClass.CROP,
            2: PlantClass.WEED,
            3: PlantClass.CROP,
            4: PlantClass.WEED,
        },
        license="CC BY-SA 4.0 with the conditions of PhenoBench",
    ),
    "folder": DataKind(about="a folder of images and masks"),
    "rows": DataKind(
        about="photographs whose crop rows are drawn as lines, or with masks",
        masks=(ROW_LABELS, "annotations", "masks"),
    ),
}


class Pair(msgspec.Struct, frozen=True, kw_only=True):
    """An image, its mask and the field or day (empty: unknown) that it belongs to.

    `ids` says what the values of the mask mean; empty: those of `PlantClass`, or colours.
    `is_named`: `ids` come from the option --ids, not from the kind of data. `shows_rows`: the mask
    is a drawing of crop rows, from which labels are made.
    """

    image: Path
    mask: Path
    group: str
    ids: MaskIds = {}
    is_named: bool = False
    shows_rows: bool = False


def find_pairs(
    folder: Path,
    kind: str,
    images: Sequence[str] = (),
    masks: Sequence[str] = (),
    ids: MaskIds | None = None,
    advice: str = ADVICE,
) -> tuple[list[Pair], list[str]]:
    """Find all complete pairs, sorted by name, and what is wrong with the rest.

    `images` and `masks` replace the folders of this kind, `ids` what the values of its masks mean,
    also in the table beside them; `advice` says what to do where there are no such folders.

    Raises: ConfigError: no pair at all.
    """
    known = KINDS[kind]
    layout = find_layout(folder, images or known.images, masks or known.masks, advice)
    is_named = ids is not None
    if not is_named and not known.ids:
        ids = find_table_ids(folder)
    pairs, problems = (
        [],
        [f"{folder / name}: {reason}" for reason, name in layout.left_out],
    )
    for item in layout.items:
        pair = _make_pair(folder, item, known.ids if ids is None else ids)
        if isinstance(pair, Pair):
            shows_rows = kind == "rows" and ROW_LABELS in pair.mask.relative_to(folder).parts
            pairs.append(msgspec.structs.replace(pair, is_named=is_named, shows_rows=shows_rows))
        else:
            problems.append(pair)
    if not pairs:
        raise ConfigError(
            f"{folder} has no image with a mask; the first problem: {problems[0]}; see "
            "agribot dataset check"
        )
    return pairs, problems


def _make_pair(folder: Path, item: Item, ids: MaskIds) -> Pair | str:
    if item.image is None:
        return f"{folder / (item.mask or '')}: mask without an image"
    if item.mask is None:
        return f"{folder / item.image}: image without a mask"
    return Pair(image=folder / item.image, mask=folder / item.mask, group=item.group, ids=ids)


def read_pairs(
    pairs: Sequence[Pair], problem: Callable[[str], None]
) -> Iterator[tuple[ByteArray, ByteArray]]:
    """Read (image_rgb, label) of each pair that is whole; `problem` gets every other one."""
    for pair in pairs:
        try:
            yield read_pair(pair)
        except PictureError as error:
            problem(str(error))


class PairFiles:
    """Pictures and labels that are read whenever they are asked for, and take no memory."""

    def __init__(self, pairs: Sequence[Pair]) -> None:
        self.pairs = pairs

    def __len__(self) -> int:
        return len(self.pairs)

    def __getitem__(self, index: int) -> tuple[ByteArray, ByteArray]:
        """Read a pair.

        Raises: PictureError: a file has changed since it was checked.
        """
        return read_pair(self.pairs[index])


def read_pair(pair: Pair) -> tuple[ByteArray, ByteArray]:
    """Read image_rgb (height, width, 3) and label (height, width) of a pair.

    Raises: PictureError: a file cannot be read, the mask does not fit the image, or holds nothing
    that counts.
    """
    image_rgb = read_picture(pair.image)
    if pair.shows_rows:
        return image_rgb, _label_by_lines(image_rgb, pair.mask)
    label = read_label(pair.mask, pair.ids, is_named=pair.is_named)
    if label.shape != image_rgb.shape[:2]:
        raise PictureError(
            f"{pair.mask}: is {label.shape[1]} x {label.shape[0]} pixels, its image "
            f"{image_rgb.shape[1]} x {image_rgb.shape[0]}; export the mask at the image's size"
        )
    if (label == UNLABELLED).all():
        raise PictureError(f"{pair.mask}: {ALL_IGNORED}")
    return image_rgb, label


def _label_by_lines(image_rgb: ByteArray, path: Path) -> ByteArray:
    from agribot.lab.rows.labelled import read_lines
    from agribot.lab.rows.teacher import label_plants

    return label_plants(image_rgb, read_lines(path, image_rgb.shape))


def read_label(path: Path, ids: MaskIds, *, is_named: bool = False) -> ByteArray:
    """Read the class of every pixel, (H, W), 255 where it does not count.

    `is_named`: the ids are those of the option --ids, which the messages then name.

    Raises: PictureError: unreadable, or values that are no class.
    """
    mask = open_mask(path)
    label = read_classes(mask, ids)
    if label is None:
        raise PictureError(f"{path}: {explain_no_classes(mask, is_named=is_named)}")
    unknown = int((label == UNKNOWN).sum())
    if unknown:
        allowed = f"weed 0, crop 1, soil 2, unlabelled 255; {USUAL_COLOURS}"
        if ids:
            allowed = f"values {', '.join(format_key(key) for key in sorted(ids))}"
        source = ", as --ids says" if is_named else ""
        raise PictureError(
            f"{path}: {unknown} pixels have a value or colour that is no class; allowed: "
            f"{allowed}{source}{advise_ids(mask)}"
        )
    return label


def tally_classes(read: Iterable[tuple[ByteArray, ByteArray]]) -> ClassTally:
    """Add up the classes of pictures and labels, one after the other."""
    tally = ClassTally()
    for image_rgb, label in read:
        tally.add(image_rgb, label)
    return tally


def refuse_doubt(tally: ClassTally, pairs: Iterable[Pair], folder: Path) -> None:
    """Refuse labels whose classes look swapped, before anything is learnt from them.

    Raises: ConfigError: most of the ground is weed, or the soil is greener than the plants.
    """
    doubt = tally.explain_doubt()
    if doubt:
        holds_values = any(_holds_values(pair.mask) for pair in pairs)
        raise ConfigError(f"{folder}: {doubt}; {advise_swapped(holds_values=holds_values)}")


def check_sample(pairs: Sequence[Pair], folder: Path) -> None:
    """Refuse labels whose classes look swapped in some of the pairs, spread over all of them.

    Raises: ConfigError: most of the ground is weed, or the soil is greener than the plants.
    """
    some = pairs[:: -(-len(pairs) // SAMPLE_PAIRS)]
    refuse_doubt(tally_classes(read_pairs(some, lambda _text: None)), some, folder)


def _holds_values(path: Path) -> bool:
    """Return whether a mask that is read without ids holds values."""
    try:
        return open_mask(path).mode in VALUE_MODES
    except PictureError:
        return False


def split_fold(pairs: Sequence[Pair], folds: int, fold: int) -> tuple[list[Pair], list[Pair]]:
    """Split training and held-out pairs of a fold; groups stay whole where there are enough.

    Raises: ConfigError: fewer pairs than folds, or no such fold.
    """
    if not 2 <= folds <= len(pairs) or not 0 <= fold < folds:
        raise ConfigError(
            f"--fold {fold} of --folds {folds}: out of range; give 2 to {len(pairs)} folds, as "
            "many "
            "as images, and a fold from 0 to one less"
        )
    groups = sorted({pair.group for pair in pairs})
    if len(groups) >= folds:
        held = set(groups[fold::folds])
        test = [pair for pair in pairs if pair.group in held]
    else:
        test = list(pairs[fold::folds])
    names = {pair.image for pair in test}
    return [pair for pair in pairs if pair.image not in names], test
