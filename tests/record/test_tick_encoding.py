from __future__ import annotations

import msgspec
import numpy as np
import pytest

from agribot.core.errors import RecordingError
from agribot.core.messages import CropCover, WeedScores
from agribot.record.ticks import decode_tick, encode_tick, strip_pixels
from tests.record import record_samples as samples


def test_a_tick_survives_encoding_but_for_its_pixels() -> None:
    for record in samples.ticks(30, with_camera=True):
        decoded = decode_tick(encode_tick(record))
        assert samples.without_frames(decoded) == samples.without_frames(strip_pixels(record))
        assert [f.index for f in decoded.batch.frames] == [f.index for f in record.batch.frames]
        assert all(f.image_rgb.shape == (0, 0, 3) for f in decoded.batch.frames)


def test_numpy_numbers_in_a_tick_are_recorded_as_numbers() -> None:
    record = samples.ticks(1)[0]
    estimate = msgspec.structs.replace(record.estimate, x_map_m=np.float64(1.25))
    decoded = decode_tick(encode_tick(msgspec.structs.replace(record, estimate=estimate)))
    assert decoded.estimate.x_map_m == 1.25


def test_a_tick_of_another_version_is_refused_with_the_way_out() -> None:
    with pytest.raises(RecordingError, match="version that recorded it"):
        decode_tick(msgspec.msgpack.encode({"batch": {"t_s": 1.0}}))


def test_what_a_scene_tells_of_its_picture_is_recorded_and_may_be_missing() -> None:
    cover = CropCover(
        x_body_m=0.3, y_body_m=-0.8, cell_m=0.025, rows=2, columns=8, crop=b"\x81\x00",
        seen=b"\xff\xff",
    )  # fmt: skip
    scores = WeedScores(
        x_body_m=0.3, y_body_m=-0.8, cell_m=0.025, rows=1, columns=4, scores=b"\x00\x01\x80\xff"
    )
    scene = msgspec.structs.replace(
        samples.scene(3, 1.0), crop_cover=cover, weed_scores=scores, picture_crc32=2**32 - 1
    )
    record = msgspec.structs.replace(samples.ticks(1)[0], scenes=(scene,))
    data = encode_tick(record)
    assert decode_tick(data).scenes == (scene,)
    old = msgspec.msgpack.decode(data)
    for name in ("crop_cover", "weed_scores", "picture_crc32"):
        del old["scenes"][0][name]
    assert decode_tick(msgspec.msgpack.encode(old)).scenes == (samples.scene(3, 1.0),)
