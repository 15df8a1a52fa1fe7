"""Pictures of recordings become a set that a network learns from, by their rows alone."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np
import numpy.typing as npt
from PIL import Image, UnidentifiedImageError

from agribot.app.calibration.recorded_robot import read_measured_robot
from agribot.app.run_recording import find_recording
from agribot.autonomy.perceive.ground import GroundLookup
from agribot.core import topics
from agribot.core.config import RunConfig
from agribot.core.errors import ConfigError, RecordingError
from agribot.core.messages import ByteArray, RowLine
from agribot.lab.dataset.row_labels import (
    FAR_M,
    GreenHistogram,
    RowLabeller,
    RowProfile,
    measure_green,
)
from agribot.lab.dataset.taught_set import TaughtSet
from agribot.record.mcap_file import read_messages
from agribot.record.replay import read_config
from agribot.ros.messages.rosmsg import read_compressed_image

# A picture that differs from the one before by less, in levels of 255, was taken at a standstill.
LEAST_CHANGE = 1.5
LOOK_EVERY = 8  # pixels, to see whether anything changed
Progress = Callable[[int], None]
IMAGE = topics.IMAGE


class RowLabelReport(msgspec.Struct, frozen=True, kw_only=True):
    """Result for the pictures; shares are of the pixels of those that were labelled."""

    folder: str
    pictures: int
    labelled: int
    without_row: int
    at_standstill: int
    half_row_m: float
    green_threshold: float
    pixel_ratio: dict[str, float]


class RecordedPictures:
    """The pictures of the camera in a recording, and the robot that took them.

    Raises: RecordingError: no recording, or none with pictures; ConfigError: no camera.
    """

    def __init__(self, path: Path, pitch_m: float | None = None) -> None:
        self.path = find_recording(path)
        config = read_config(self.path)
        robot = read_measured_robot(self.path, config)
        if robot.camera is None:
            raise ConfigError(f"{self.path}: its robot has no camera; there is nothing to label")
        self._size_px = (robot.camera.height_px, robot.camera.width_px)
        ground = GroundLookup(robot.camera, robot.body_from_camera(), self._size_px, FAR_M)
        self.labeller = RowLabeller(ground, pitch_m or _find_pitch_m(config))
        self._count = sum(1 for _ in read_messages(self.path, IMAGE))
        if not self._count:
            raise RecordingError(
                f"{self.path} holds no pictures; record them with --set record.image_rate_hz=1"
            )

    def __len__(self) -> int:
        return self._count

    def read(self) -> Iterator[tuple[int, bytes, ByteArray]]:
        """Read the number of each picture, its file and its pixels.

        Raises: RecordingError: a picture cannot be read, or is not of the camera's size.
        """
        for number, message in enumerate(read_messages(self.path, IMAGE)):
            jpeg = read_compressed_image(message.data)
            try:
                with Image.open(io.BytesIO(jpeg)) as image:
                    pixels = np.asarray(image.convert("RGB"))
            except (UnidentifiedImageError, OSError) as error:
                raise RecordingError(
                    f"{self.path}: picture {number} is broken ({error}); leave this drive out"
                ) from error
            if pixels.shape[:2] != self._size_px:
                raise RecordingError(
                    f"{self.path}: picture {number} is {pixels.shape[1]} x {pixels.shape[0]} "
                    f"pixels, the robot's camera takes {self._size_px[1]} x {self._size_px[0]}; "
                    "leave this drive out"
                )
            yield number, jpeg, pixels


PASSES = 3  # passes over all pictures: their greenness, their rows, their contents


class _Counter:
    """Reports how many pictures of all passes are done."""

    def __init__(self, progress: Progress) -> None:
        self._progress, self._done = progress, 0

    def __call__(self) -> None:
        self._done += 1
        self._progress(self._done)


class _Look(NamedTuple):
    """The row of each picture that shows one to a robot that moves, and how many do not."""

    lines: dict[int, RowLine]
    without_row: int
    at_standstill: int


def label_recordings(
    recordings: Sequence[RecordedPictures], out: Path, progress: Progress
) -> RowLabelReport:
    """Write the pictures with a row to `out`/images and their classes to `out`/masks.

    Raises: ConfigError: the folder holds files, or the rows cannot teach; RecordingError: pictures
    that cannot be read.
    """
    taught = TaughtSet(out)
    green, profile = GreenHistogram(), RowProfile()
    counted = _Counter(progress)
    for recording in recordings:
        for _, _, pixels in recording.read():
            green.add(measure_green(pixels))
            counted()
    threshold = green.find_threshold()
    looks = [_look_through(recording, threshold, profile, counted) for recording in recordings]
    total = sum(len(look.lines) for look in looks)
    if not total:
        raise ConfigError(
            "no picture shows a row that the robot drives along; label by hand (agribot label)"
        )
    half_row_m = profile.find_half_row_m()
    for index, (recording, look) in enumerate(zip(recordings, looks, strict=True)):
        for number, jpeg, pixels in recording.read():
            if number in look.lines:
                picture = recording.labeller.place(measure_green(pixels), look.lines[number])
                label = recording.labeller.label(picture, threshold, half_row_m)
                name = f"{recording.path.parent.name}-{index}-{number:05d}.jpg"
                taught.add(name, jpeg, label)
            counted()
    return RowLabelReport(
        folder=str(out),
        pictures=sum(map(len, recordings)),
        labelled=total,
        without_row=sum(look.without_row for look in looks),
        at_standstill=sum(look.at_standstill for look in looks),
        half_row_m=half_row_m,
        green_threshold=threshold,
        pixel_ratio=taught.pixel_ratio,
    )


def _look_through(
    recording: RecordedPictures, threshold: float, profile: RowProfile, counted: _Counter
) -> _Look:
    lines: dict[int, RowLine] = {}
    before: npt.NDArray[np.int16] | None = None
    still = without_row = 0
    for number, _, pixels in recording.read():
        counted()
        small = pixels[::LOOK_EVERY, ::LOOK_EVERY].astype(np.int16)
        if before is not None and float(np.abs(small - before).mean()) < LEAST_CHANGE:
            still += 1
            continue
        before = small
        green = measure_green(pixels)
        line = recording.labeller.find_line(green, threshold)
        if line is None:
            without_row += 1
            continue
        lines[number] = line
        profile.add(recording.labeller.place(green, line), threshold)
    return _Look(lines, without_row, still)


def _find_pitch_m(config: RunConfig) -> float | None:
    """Find the row spacing of a profile's field; None for a plan."""
    field = config.field
    return None if config.plan or field.row_count < 2 else field.row_pitch_m
