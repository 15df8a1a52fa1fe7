"""TickRecord as MessagePack: lossless but for pixels of camera frames and scans of a lidar."""

from __future__ import annotations

import msgspec
import numpy as np

from agribot.core.errors import RecordingError
from agribot.core.messages import ByteArray, CameraFrame, TickRecord
from agribot.record.old_reasons import lift_reasons
from agribot.record.old_requests import lift_requests

# Frames keep their time and index; the pixels go to the image topic, at its own rate.
NO_PIXELS: ByteArray = np.empty((0, 0, 3), dtype=np.uint8)
NO_PIXELS.flags.writeable = False


def _encode_numpy(value: object) -> object:
    if isinstance(value, np.ndarray):
        return (value.dtype.str, value.shape, value.tobytes())
    if isinstance(value, np.generic):
        return value.item()
    raise NotImplementedError(f"cannot record a {type(value).__name__}")


def _decode_array(kind: type, value: tuple[str, list[int], bytes]) -> object:
    dtype, shape, data = value
    return np.frombuffer(data, dtype=np.dtype(dtype)).reshape(shape)


_ENCODER = msgspec.msgpack.Encoder(enc_hook=_encode_numpy)
_DECODER = msgspec.msgpack.Decoder(TickRecord, dec_hook=_decode_array)


def strip_pixels(record: TickRecord) -> TickRecord:
    """Return the same record with an empty image in every frame, and without scans."""
    if not (record.batch.frames or record.batch.scans):
        return record
    frames = tuple(
        CameraFrame(t_s=frame.t_s, index=frame.index, image_rgb=NO_PIXELS)
        for frame in record.batch.frames
    )
    batch = msgspec.structs.replace(record.batch, frames=frames, scans=())
    return msgspec.structs.replace(record, batch=batch)


def encode_tick(record: TickRecord) -> bytes:
    return _ENCODER.encode(strip_pixels(record))


def decode_tick(data: bytes) -> TickRecord:
    """Decode the bytes of `encode_tick`.

    Raises: RecordingError: the bytes are no TickRecord of this version.
    """
    try:
        return lift_requests(lift_reasons(_DECODER.decode(data)), data)
    except msgspec.MsgspecError as error:
        raise RecordingError(
            f"the recording holds a tick that this version cannot read ({error}); "
            "replay it with the version that recorded it"
        ) from error
