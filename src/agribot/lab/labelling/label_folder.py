"""A folder of photographs while somebody labels it: which are done, and what the network says.

Masks lie where `agribot train` looks for them; work that is not finished and what the network is
unsure of lie in `.label` beside them, so that no network learns from a half-corrected mask.
"""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import numpy.typing as npt

from agribot.core.errors import AgribotError, ConfigError, explain_os_error
from agribot.core.messages import ByteArray, PlantClass
from agribot.core.whole_file import write_at_once
from agribot.lab.dataset.classes import NAMES, UNLABELLED, MaskIds, names_colours
from agribot.lab.dataset.importing import encode_mask
from agribot.lab.dataset.layouts import IMAGE_FOLDERS, MASK_FOLDERS, Item, find_layout
from agribot.lab.dataset.pictures import read_picture
from agribot.lab.labelling.guesses import Guess
from agribot.lab.labelling.superpixels import find_superpixels
from agribot.lab.train.photographs import read_label
from agribot.ui.server.label_page import (
    LabelledClasses,
    PictureState,
    SavedMeanwhileError,
    State,
)

WORK = ".label"
CLASSES = (*PlantClass, UNLABELLED)


class _Judged(msgspec.Struct):
    """The network's doubt of the plants in each picture, for the next start."""

    model: str
    doubt: dict[str, float]


class LabelFolder:
    """The pictures of a set, by their number in the order of their names."""

    def __init__(
        self,
        root: Path,
        guess: Callable[[ByteArray], Guess],
        model: str,
        ids: MaskIds | None = None,
    ) -> None:
        """Find the pictures.

        Raises: ConfigError: no folder of pictures, or ids that lack a class.
        """
        self.root, self._guess, self._model = root, guess, model
        self._ids = ids or {}
        self._values = _invert(self._ids)
        self._mask_folder = _make_folders(root)
        layout = find_layout(root)
        self.left_out = layout.left_out
        self._items = [one for one in layout.items if one.image is not None]
        if not self._items:
            raise ConfigError(f"{root / 'images'} has no picture; put the photographs there")
        self._doubt = self._read_judged()
        self._lock = threading.Lock()
        self._saving = threading.Lock()

    @property
    def about(self) -> str:
        return f"{self.root.name or self.root} · {self._model}"

    def list_pictures(self) -> list[PictureState]:
        """List all pictures, those first of whose plants the network is least sure."""
        with self._lock:
            found = [
                PictureState(
                    number=number,
                    name=item.key,
                    state=self._state_of(self._item(number)),
                    uncertainty=self._doubt.get(item.key),
                )
                for number, item in enumerate(self._items)
            ]
        return sorted(found, key=lambda one: (-(one.uncertainty or 0.0), one.number))

    def read_picture(self, number: int) -> ByteArray:
        return read_picture(self._image(number))

    def find_superpixels(self, number: int) -> npt.NDArray[np.uint16]:
        return find_superpixels(self.read_picture(number))

    def find_plants(self, number: int) -> npt.NDArray[np.uint16]:
        return self._guess(self.read_picture(number)).plant

    def read_classes(self, number: int) -> LabelledClasses:
        """Read what was saved, else what was begun, else what the network says.

        Raises: AgribotError: a file cannot be read, or does not fit its picture.
        """
        item, image_rgb = self._item(number), self.read_picture(number)
        state, revision = self._state_of(item), self._read_revision(item)
        if state == "draft":
            label = read_label(self._draft(item), {})
        elif item.mask is not None:
            label = read_label(self.root / item.mask, self._ids, is_named=bool(self._ids))
        else:
            label = self._guess(image_rgb).class_id
        if label.shape != image_rgb.shape[:2]:
            raise ConfigError(
                f"{item.mask or item.key}: is {label.shape[1]} x {label.shape[0]} pixels, its "
                f"picture {image_rgb.shape[1]} x {image_rgb.shape[0]}; move the mask away"
            )
        return LabelledClasses(class_id=label, state=state, revision=revision)

    def save(self, number: int, class_id: ByteArray, *, is_done: bool, revision: str = "") -> str:
        """Save a finished mask where a training reads it, or one that was only begun.

        `revision` is that of what was read or saved before; what somebody else has saved since is
        not replaced. Returns the new one.
        Raises: RecordingError: the disk does not take it. ConfigError: a mask that is no PNG.
        SavedMeanwhileError: somebody has; the classes are kept beside the drafts.
        """
        item = self._item(number)
        if not np.isin(class_id, CLASSES).all():
            raise ConfigError(f"{item.key}: the classes hold other values; save 0, 1, 2 or 255")
        with (
            explain_os_error(
                f"cannot save the mask of {item.key}",
                "make room on the disk, or check that the folder may be written",
            ),
            self._saving,
        ):
            item = self._item(number)
            if revision and revision != self._read_revision(item):
                self._refuse_to_replace(item, class_id, is_done)
            elif is_done:
                self._finish(number, item, class_id)
            else:
                self._draft(item).parent.mkdir(parents=True, exist_ok=True)
                write_at_once(self._draft(item), encode_mask(class_id))
            return self._read_revision(self._item(number))

    def _finish(self, number: int, item: Item, class_id: ByteArray) -> None:
        path = self._mask(item)
        path.parent.mkdir(parents=True, exist_ok=True)
        write_at_once(path, encode_mask(self._values[class_id]), is_synced=True)
        self._draft(item).unlink(missing_ok=True)
        self._confirm_note(item)
        with self._lock:
            saved = path.relative_to(self.root).as_posix()
            self._items[number] = msgspec.structs.replace(item, mask=saved)

    def _refuse_to_replace(self, item: Item, class_id: ByteArray, is_done: bool) -> None:
        """Keep classes beside the drafts, unless the very same ones are saved already.

        Raises: SavedMeanwhileError: others are.
        """
        target = self._mask(item) if is_done else self._draft(item)
        data = encode_mask(self._values[class_id] if is_done else class_id)
        if target.is_file() and target.read_bytes() == data:  # asked again: its answer was lost
            return
        folder = self.root / WORK / "kept"
        number = 1
        while (kept := folder / f"{item.key}-{number}.png").exists():
            number += 1
        kept.parent.mkdir(parents=True, exist_ok=True)
        write_at_once(kept, encode_mask(class_id), is_synced=True)
        raise SavedMeanwhileError(
            f"somebody else has saved {item.key} since you opened it, and theirs is shown now; "
            f"what you drew is kept in {kept.relative_to(self.root)}"
        )

    def _read_revision(self, item: Item) -> str:
        """Read what stands for the saved classes of a picture, those that were begun included."""
        digest = hashlib.sha256()
        for path in (self._draft(item), self.root / item.mask if item.mask else None):
            data = path.read_bytes() if path is not None and path.is_file() else b""
            digest.update(len(data).to_bytes(8, "little") + data)
        return digest.hexdigest()[:32]

    def judge_all(self, is_stopped: Callable[[], object]) -> None:
        """Ask the network about every picture that it has not seen, and remember how unsure it is.

        A picture that cannot be read counts as a sure one: it comes last, and says why when it is
        opened.
        """
        for item in self._items:
            if is_stopped() or item.key in self._doubt or item.image is None:
                continue
            try:
                doubt = self._guess(read_picture(self.root / item.image)).doubt
            except AgribotError:
                doubt = 0.0
            with self._lock:
                self._doubt[item.key] = doubt
        self._write_judged()

    def _item(self, number: int) -> Item:
        """Return a picture with the mask currently in the folder, from any source."""
        item = self._items[number]
        usual = (self._mask_folder / f"{item.key}.png").relative_to(self.root).as_posix()
        names = [name for name in (item.mask, usual) if name and (self.root / name).is_file()]
        return msgspec.structs.replace(item, mask=names[0] if names else None)

    def _image(self, number: int) -> Path:
        image = self._items[number].image
        assert image is not None  # only pictures were taken
        return self.root / image

    def _draft(self, item: Item) -> Path:
        return self.root / WORK / "drafts" / f"{item.key}.png"

    def _mask(self, item: Item) -> Path:
        if item.mask is None:
            return self._mask_folder / f"{item.key}.png"
        path = self.root / item.mask
        if path.suffix.lower() != ".png":
            raise ConfigError(f"{item.mask}: only masks that are PNG are written; convert it first")
        return path

    def _state_of(self, item: Item) -> State:
        if self._draft(item).is_file():
            return "draft"
        if item.mask is None or self._read_note(item).get("is_mask_from_network"):
            return "new"
        return "done"

    def _note(self, item: Item) -> Path:
        return self.root / "notes" / f"{item.key}.json"

    def _read_note(self, item: Item) -> dict[str, Any]:
        """Read what the robot noted of a frame that an operator kept."""
        try:
            note = msgspec.json.decode(self._note(item).read_bytes())
        except (OSError, msgspec.DecodeError):
            return {}
        return note if isinstance(note, dict) else {}

    def _confirm_note(self, item: Item) -> None:
        note = self._read_note(item)
        if note.get("is_mask_from_network"):
            note["is_mask_from_network"] = False
            data = msgspec.json.format(msgspec.json.encode(note), indent=2)
            write_at_once(self._note(item), data + b"\n")

    def _read_judged(self) -> dict[str, float]:
        try:
            found = msgspec.json.decode(
                (self.root / WORK / "judged.json").read_bytes(), type=_Judged
            )
        except (OSError, msgspec.DecodeError):
            return {}
        return found.doubt if found.model == self._model else {}

    def _write_judged(self) -> None:
        """Keep the order for the next start; without a place for it the network is asked again."""
        path = self.root / WORK / "judged.json"
        judged = _Judged(model=self._model, doubt=dict(self._doubt))
        try:
            path.parent.mkdir(exist_ok=True)
            write_at_once(path, msgspec.json.encode(judged))
        except OSError:
            return


def _make_folders(root: Path) -> Path:
    """Find the folder of the masks, or make it.

    Raises: ConfigError: no folder of pictures. RecordingError: it cannot be written.
    """
    if not root.is_dir():
        raise ConfigError(f"{root} is no folder; check the path")
    if not any((root / name).is_dir() for name in IMAGE_FOLDERS):
        raise ConfigError(f"{root} has no folder 'images'; make one and put the photographs there")
    found = next((root / name for name in MASK_FOLDERS if (root / name).is_dir()), root / "masks")
    with explain_os_error(f"cannot make {found}", "copy the photographs where you may write"):
        found.mkdir(exist_ok=True)
    return found


def _invert(ids: Mapping[int, int]) -> ByteArray:
    """Make the table from classes to the values that a mask stores.

    Raises: ConfigError: a class, or what is ignored, has no value.
    """
    table = np.arange(256, dtype=np.uint8)
    if names_colours(ids):
        raise ConfigError("--ids names colours, and masks are written as values; name values")
    for name, kind in NAMES.items() if ids else ():
        values = sorted(value for value, meant in ids.items() if meant == kind)
        if not values:
            raise ConfigError(f"--ids names no value for {name}; masks need one")
        table[kind] = kind if kind == UNLABELLED and kind in values else values[0]
    return table
