"""Frames of videos, webcams and network cameras, where OpenCV is installed."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from agribot.core.errors import PerceptionError
from agribot.core.extras import format_install
from agribot.core.messages import ByteArray

VIDEO_SUFFIXES = {".mp4", ".avi", ".mkv", ".mov", ".webm", ".m4v"}


def open_capture(source: str | int) -> Any:
    """Open a video, a webcam or a network camera.

    Raises: PerceptionError: OpenCV is not installed, or it cannot open the source.
    """
    # Its own lines about a missing file would come on top of ours.
    os.environ.setdefault("OPENCV_LOG_LEVEL", "OFF")
    try:
        import cv2
    except ImportError as error:
        raise PerceptionError(
            f"{source}: reading a video or camera needs OpenCV; {format_install('camera')}"
        ) from error
    capture = cv2.VideoCapture(source)
    if not capture.isOpened():
        raise PerceptionError(
            f"{source}: cannot be opened as a video or camera; check the path, the number of the "
            "camera or the address"
        )
    return capture


def read_frames(file: Path) -> Iterator[ByteArray]:
    """Read all frames, (height, width, 3) uint8 in red, green, blue.

    Raises: PerceptionError: no frame can be read.
    """
    capture = open_capture(str(file))
    any_frame = False
    try:
        while True:
            good, frame_bgr = capture.read()
            if not good:
                break
            any_frame = True
            yield np.ascontiguousarray(frame_bgr[..., ::-1])
    finally:
        capture.release()
    if not any_frame:
        raise PerceptionError(f"{file}: holds no frame that can be read; check that it plays")
