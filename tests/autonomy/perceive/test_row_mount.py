"""A camera's mount from drawn rows of known distance, whose mount is known."""

from __future__ import annotations

import math

import msgspec
import numpy as np

from agribot.autonomy.perceive.far_row_line import measure_far_contrast
from agribot.autonomy.perceive.ground import GroundLookup
from agribot.autonomy.perceive.row_mount import RowMountFit, fit_row_mount
from agribot.core.geo import LINK_FROM_OPTICAL, transform
from agribot.core.messages import FloatArray
from tests.autonomy.perceive.drawn_field import CAMERA
from tests.autonomy.perceive.test_far_row_line import HEIGHT_M, PITCH_M, SHAPE, draw, draw_rows

PITCH_RAD = math.radians(27.4)
PICTURES = 8


def draw_pictures(seed: int, *, has_rows: bool = True) -> list[FloatArray]:
    """Draw what a camera sees along rows, or of plants that are strewn about."""
    pose = transform((0.3, 0.0, HEIGHT_M), (0.0, PITCH_RAD, 0.0)) @ LINK_FROM_OPTICAL
    ground, rng = GroundLookup(CAMERA, pose, SHAPE, 2.5), np.random.default_rng(seed)
    drawn = []
    for _ in range(PICTURES):
        if has_rows:
            class_map = draw_rows(rng, rng.uniform(-0.2, 0.2), rng.normal(0.0, 0.08), ground)
        else:
            class_map = draw(ground, rng.uniform(0.4, 7.0, 250), rng.uniform(-3.0, 3.0, 250))
        drawn.append(measure_far_contrast(class_map, None))
    return drawn


def fit(contrasts: list[FloatArray], spacing_m: float = PITCH_M) -> RowMountFit:
    return fit_row_mount(contrasts, CAMERA, spacing_m, np.random.default_rng(0))


def test_rows_of_known_distance_tell_height_pitch_and_roll_of_the_camera() -> None:
    contrasts = draw_pictures(1)
    found = fit(contrasts)
    assert found.complaints() == ()
    assert abs(found.pitch_rad - PITCH_RAD) < 2.0 * found.pitch_std_rad
    assert abs(found.height_m - HEIGHT_M) < 2.0 * found.height_std_m
    assert found.pitch_std_rad < math.radians(1.0)
    assert found.roll_rad is not None
    assert abs(found.roll_rad) < 2.0 * found.roll_std_rad
    few = fit(contrasts[:2])
    assert "at least 8 are needed" in few.complaints()[0]


def test_rows_twice_as_far_apart_are_seen_from_twice_as_high() -> None:
    found = fit(draw_pictures(2), spacing_m=2.0 * PITCH_M)
    assert abs(found.height_m - 2.0 * HEIGHT_M) < 0.15
    assert abs(found.pitch_rad - PITCH_RAD) < 2.0 * found.pitch_std_rad


def test_plants_strewn_about_tell_no_mount() -> None:
    found = fit(draw_pictures(3, has_rows=False))
    assert found.complaints()


def test_what_does_not_show_is_refused_with_what_to_do() -> None:
    known = RowMountFit(
        pictures=20, pitch_rad=0.4, pitch_std_rad=0.01, height_m=0.8, height_std_m=0.02,
        roll_rad=None, roll_std_rad=0.1, tilt_std_rad=0.01,
    )  # fmt: skip
    assert known.complaints() == ()
    for change in ({"pitch_std_rad": math.inf}, {"pitch_std_rad": 0.1}, {"height_std_m": 0.2}):
        reasons = msgspec.structs.replace(known, **change).complaints()
        assert len(reasons) == 1
        assert "; give " in reasons[0]
