"""Whether a camera gives pictures, their size and their rate."""

from __future__ import annotations

import os
import threading
import time
from typing import Any, NamedTuple

LIMIT_S = 8.0  # longest wait for a driver that hangs
PICTURES = 8  # pictures whose times are measured, after the first


class CameraAnswer(NamedTuple):
    """`stated_hz` is what the driver says, 0 where it does not; `rate_hz` was measured."""

    width_px: int
    height_px: int
    stated_hz: float
    rate_hz: float


def probe_camera(path: str, limit_s: float = LIMIT_S) -> CameraAnswer:
    """Open a camera as it is set, and take some pictures.

    Raises: OSError: it cannot be opened, or gives no picture in time.
    ImportError: OpenCV is not installed.
    """
    import cv2

    found: list[CameraAnswer | OSError] = []
    reader = threading.Thread(
        target=lambda: found.append(_take(cv2, path)), name=f"probes {path}", daemon=True
    )
    reader.start()
    reader.join(limit_s)
    if not found:
        raise OSError(f"gave no picture within {limit_s:g} s")
    (answer,) = found
    if isinstance(answer, OSError):
        raise answer
    return answer


def _take(cv2: Any, path: str) -> CameraAnswer | OSError:
    os.environ.setdefault("OPENCV_LOG_LEVEL", "OFF")
    capture = cv2.VideoCapture(path)
    try:
        is_good, picture = capture.read()
        if not is_good:
            return OSError("gives no picture")
        begun_s, count = time.monotonic(), 0
        while count < PICTURES and capture.read()[0]:
            count += 1
        passed_s = time.monotonic() - begun_s
        height, width = picture.shape[:2]
        stated_hz = float(capture.get(cv2.CAP_PROP_FPS))
        rate_hz = count / passed_s if count and passed_s > 0.0 else 0.0
        return CameraAnswer(width, height, stated_hz, rate_hz)
    except cv2.error as error:
        return OSError(str(error))
    finally:
        capture.release()
