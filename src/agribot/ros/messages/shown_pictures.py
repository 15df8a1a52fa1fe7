"""Pictures in ROS messages, made small enough for the page."""

from __future__ import annotations

import base64
import io
import math
from typing import Any

import numpy as np
from PIL import Image

from agribot.core.errors import BridgeError
from agribot.core.messages import ByteArray
from agribot.ros.messages.sensor_readers import ImageReader

MOST_SIDE_PX = 640  # side of a picture beside the map
MOST_TEXTURE_PX = 1024  # side of a picture that lies on the ground
MOST_DISPARITY_PX = 320
MOST_COMPRESSED_BYTES = 300_000  # size of a picture that is sent unchanged
_QUALITY = 80
_MONO = {"8UC1": "mono8", "8UC3": "bgr8", "16UC1": "mono16"}  # the encodings of OpenCV

Value = dict[str, Any]


def show_image(message: Any) -> tuple[Value, str]:
    """Show a raw picture as a JPEG.

    Raises: BridgeError: an encoding that is not read, or too few bytes.
    """
    picture, note = shrink(read_picture(message), MOST_SIDE_PX)
    return to_file(picture), note


def show_compressed(message: Any) -> tuple[Value, str]:
    """Show a picture that is a file already, as it is where it is small.

    Raises: BridgeError: no picture.
    """
    data = np.asarray(message.data, dtype=np.uint8).tobytes()
    if len(data) <= MOST_COMPRESSED_BYTES:
        return {"format": message.format, "data": base64.b64encode(data).decode()}, ""
    picture, note = shrink(read_picture(message), MOST_SIDE_PX)
    return to_file(picture), note


def show_disparity(message: Any) -> tuple[Value, str]:
    """Show a picture of disparities, thinned to 32-bit numbers that a browser can colour.

    Raises: BridgeError: another encoding than 32FC1, or too few bytes.
    """
    image = message.image
    if image.encoding != "32FC1":
        raise BridgeError(f"disparities of encoding {image.encoding[:20]}; send 32FC1")
    width, height, step = int(image.width), int(image.height), int(image.step)
    data = np.asarray(image.data, dtype=np.uint8)
    if step < 4 * width or data.size < height * step or width * height == 0:
        raise BridgeError(
            f"{data.size} bytes are no image of {width} x {height} pixels; send whole rows"
        )
    rows = np.ascontiguousarray(data[: height * step].reshape(height, step)[:, : 4 * width])
    values = rows.view(">f4" if image.is_bigendian else "<f4")
    every = max(1, math.ceil(max(width, height) / MOST_DISPARITY_PX))
    kept = np.ascontiguousarray(values[::every, ::every], dtype="<f4")
    shown = {
        "width": kept.shape[1], "height": kept.shape[0], "encoding": "32FC1",
        "step": 4 * kept.shape[1], "is_bigendian": 0,
        "data": base64.b64encode(kept.tobytes()).decode(),
    }  # fmt: skip
    limits = {
        "min_disparity": float(message.min_disparity),
        "max_disparity": float(message.max_disparity),
    }
    note = f"every {every}th pixel of {width} x {height}" if every > 1 else ""
    return {"image": shown, **limits}, note


def read_picture(message: Any) -> Image.Image:
    """Read a sensor_msgs/Image or CompressedImage.

    Raises: BridgeError: not a picture that can be read.
    """
    reader = ImageReader(None)
    if not hasattr(message, "encoding"):
        return Image.fromarray(reader.read_compressed(message, 0.0).image_rgb)
    message.encoding = _MONO.get(message.encoding, message.encoding)
    return Image.fromarray(reader.read_raw(message, 0.0).image_rgb)


def shrink(picture: Image.Image, most_px: int) -> tuple[Image.Image, str]:
    """Shrink a picture until its longer side is at most `most_px`."""
    width, height = picture.size
    longest = max(width, height)
    if longest <= most_px:
        return picture, ""
    size = (max(1, width * most_px // longest), max(1, height * most_px // longest))
    return picture.resize(size, Image.Resampling.BOX), f"{width} x {height} pixels made smaller"


def to_file(picture: Image.Image | ByteArray, kind: str = "jpeg") -> Value:
    """Make the CompressedImage of a picture."""
    if not isinstance(picture, Image.Image):
        picture = Image.fromarray(picture)
    buffer = io.BytesIO()
    picture.convert("RGB").save(buffer, format=kind, quality=_QUALITY)
    return {"format": kind, "data": base64.b64encode(buffer.getvalue()).decode()}
