"""The lines of the original's Arduino are read as the numbers that it measured."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from agribot.core.errors import ConfigError
from agribot.drivers.board.letter_imu import STANDARD_GRAVITY_MPS2, LetterImuDecoder, read_axes

# As it was seen on the original's own board.
SEEN = b"A-7576B2476C-14524D-749E-4615F-459G"


def decoder(axes: str = "x,y,z", **ranges: float) -> LetterImuDecoder:
    return LetterImuDecoder(read_axes(axes), pytest.fail, **ranges)


def test_the_line_of_the_original_is_one_g_and_some_turning() -> None:
    (sample,) = decoder().feed(b"noise" + SEEN + b"\r\n")
    assert sample.accel_mps2 is not None
    assert math.hypot(*sample.accel_mps2) == pytest.approx(1.01 * STANDARD_GRAVITY_MPS2, rel=0.005)
    assert sample.gyro_radps[0] == pytest.approx(math.radians(-749 / 131.072), rel=1e-3)


def test_a_board_that_is_mounted_upside_down_measures_gravity_upwards() -> None:
    (sample,) = decoder("x,-y,-z").feed(SEEN)
    assert sample.accel_mps2 is not None
    assert sample.accel_mps2[2] == pytest.approx(14524 / 16384 * STANDARD_GRAVITY_MPS2)
    assert sample.accel_mps2[1] == pytest.approx(-2476 / 16384 * STANDARD_GRAVITY_MPS2)


@pytest.mark.parametrize("axes", ["x,y", "x,x,z", "x,y,-z", "a,b,c", "x,y,z,x", ""])
def test_axes_that_no_board_can_have_are_refused(axes: str) -> None:
    with pytest.raises(ConfigError, match="axes="):
        read_axes(axes)


@given(
    st.lists(st.tuples(*[st.integers(-32768, 32767)] * 6), min_size=1, max_size=8),
    st.integers(1, 70),
    st.binary(max_size=20).filter(lambda junk: b"A" not in junk),
)
def test_readings_survive_any_cutting_and_what_stands_between_them(
    readings: list[tuple[int, ...]], size: int, junk: bytes
) -> None:
    lines = (
        "".join(f"{letter}{value}" for letter, value in zip("ABCDEF", reading, strict=True)) + "G"
        for reading in readings
    )
    data = b"".join(line.encode() + junk for line in lines)
    codec = decoder(accel_g=2.0, gyro_dps=250.0)
    found = [s for k in range(0, len(data), size) for s in codec.feed(data[k : k + size])]
    accels = [s.accel_mps2 or (math.nan,) for s in found]
    assert [round(accel[0] / STANDARD_GRAVITY_MPS2 * 16384) for accel in accels] == [
        reading[0] for reading in readings
    ]
