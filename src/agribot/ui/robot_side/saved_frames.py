"""Frames that an operator keeps for training: pairs as `agribot dataset check` reads them.

`images/NAME.png` and `masks/NAME.png` (class ids at the image's size), and `notes/NAME.json` with
where and when, and that the mask is the network's: it is to be corrected before it teaches one.
"""

from __future__ import annotations

import io
import shutil
from datetime import UTC, datetime
from itertools import count
from pathlib import Path

import msgspec
import numpy as np
from PIL import Image

from agribot.core.config import RunConfig
from agribot.core.errors import RecordingError, explain_os_error
from agribot.core.messages import ByteArray, Estimate
from agribot.ui import wire
from agribot.ui.robot_side.recent_frames import SeenFrame

FOLDER = "frames"  # beside the run, unless record.frames_dir names another
PARTS = ("images", "masks", "notes")
_MB = 1_000_000


class SavedFrames:
    """Nothing is ever overwritten: a name that is taken gets a number."""

    def __init__(self, config: RunConfig, out_dir: Path) -> None:
        self._config = config
        self._run = out_dir.resolve().name
        named = config.record.frames_dir
        self.folder = Path(named).expanduser() if named else out_dir.resolve().parent / FOLDER

    def save(self, shot: SeenFrame) -> wire.KeptFrame:
        """Where the pair lies and how many there are now.

        Raises: RecordingError: too little room is left, or the disk does not take it.
        """
        image = shot.frame.image_rgb
        pictures = {"images": _png(image), "masks": _png(_enlarge(shot.class_id, image))}
        with explain_os_error(
            f"cannot write into {self.folder}",
            "set record.frames_dir to a folder that can be written",
        ):
            for part in PARTS:
                (self.folder / part).mkdir(parents=True, exist_ok=True)
            self._check_room()
            name = self._write(shot, pictures)
            saved = sum(1 for _ in (self.folder / "images").glob("*.png"))
        image_name = f"images/{name}.png"
        return wire.KeptFrame(folder=str(self.folder), image=image_name, count=saved)

    def _check_room(self) -> None:
        limit_mb = self._config.record.min_free_mb
        free_mb = shutil.disk_usage(self.folder).free / _MB
        if free_mb < limit_mb:
            raise RecordingError(
                f"only {free_mb:.0f} MB are left on the disk, less than record.min_free_mb "
                f"({limit_mb:g}); make room, or set record.frames_dir to another disk"
            )

    def _write(self, shot: SeenFrame, pictures: dict[str, bytes]) -> str:
        name = self._claimed_name(f"{self._run}-{shot.frame.index:06d}")
        files = {self.folder / part / f"{name}.png": data for part, data in pictures.items()}
        files[self.folder / "notes" / f"{name}.json"] = self._note(shot, name)
        try:
            for path, data in files.items():
                path.write_bytes(data)
        except OSError:
            for path in files:  # half a pair would spoil the set
                path.unlink(missing_ok=True)
            raise
        return name

    def _claimed_name(self, wanted: str) -> str:
        for number in count(1):
            name = wanted if number == 1 else f"{wanted}-{number}"
            if any((self.folder / part / f"{name}.png").exists() for part in ("images", "masks")):
                continue
            try:
                (self.folder / "notes" / f"{name}.json").touch(exist_ok=False)
            except FileExistsError:
                continue
            return name
        raise AssertionError("numbers do not end")

    def _note(self, shot: SeenFrame, name: str) -> bytes:
        config = self._config
        note = {
            "image": f"images/{name}.png",
            "mask": f"masks/{name}.png",
            "is_mask_from_network": True,
            "model": config.perception.model,
            "run": self._run,
            "robot": config.robot,
            "frame_index": shot.frame.index,
            "t_s": shot.frame.t_s,
            "saved_utc": datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
            "pose": _pose(shot.estimate),
            "datum": config.field.datum,
        }
        return msgspec.json.format(msgspec.json.encode(note), indent=2) + b"\n"


def _pose(estimate: Estimate) -> dict[str, float] | None:
    if not estimate.ok:
        return None
    names = ("t_s", "x_map_m", "y_map_m", "yaw_map_rad", "pos_std_m", "yaw_std_rad")
    return {name: getattr(estimate, name) for name in names}


def _enlarge(class_id: ByteArray, image: ByteArray) -> ByteArray:
    """Resize a mask to the image: the network looks at it at a size of its own."""
    size = (image.shape[1], image.shape[0])
    mask = Image.fromarray(np.ascontiguousarray(class_id)).resize(size, Image.Resampling.NEAREST)
    return np.asarray(mask)


def _png(pixels: ByteArray) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, format="PNG", compress_level=1)
    return buffer.getvalue()
