from __future__ import annotations

import math
from collections.abc import Callable

import msgspec
import numpy as np
import pytest

from agribot.autonomy.estimate.sensors.mapped_rows import MappedRows
from agribot.autonomy.estimate.witnesses.crop_watch import CropWatch
from agribot.core.messages import CropCover
from agribot.core.pose import Pose2

ROWS = MappedRows([[(0.0, 0.0), (12.0, 0.0)], [(0.0, 0.75), (12.0, 0.75)]], 0.25)
CELL_M, ROW_CELLS, COLUMN_CELLS = 0.025, 40, 48
Place = Callable[[np.ndarray, np.ndarray], np.ndarray]


def cover(pose: Pose2, is_crop: Place, is_weed: Place) -> CropCover:
    """Show the ground from 0.4 to 1.4 m ahead, 0.6 m to either side."""
    row, column = np.indices((ROW_CELLS, COLUMN_CELLS)).astype(np.float64)
    x_m, y_m = pose.transform(0.4 + (row + 0.5) * CELL_M, -0.6 + (column + 0.5) * CELL_M)
    everywhere = np.ones(row.shape, dtype=bool)
    crop, weed, seen = (
        np.packbits(each).tobytes() for each in (is_crop(x_m, y_m), is_weed(x_m, y_m), everywhere)
    )
    return CropCover(
        x_body_m=0.4, y_body_m=-0.6, cell_m=CELL_M, rows=ROW_CELLS, columns=COLUMN_CELLS,
        crop=crop, weed=weed, seen=seen,
    )  # fmt: skip


def in_rows(x_m: np.ndarray, y_m: np.ndarray, aside_m: float = 0.0) -> np.ndarray:
    """Plants of 12 cm every 25 cm."""
    along_m = (x_m + 0.125) % 0.25 - 0.125
    across_m = (y_m - aside_m + 0.375) % 0.75 - 0.375
    return np.hypot(along_m, across_m) <= 0.06


def scattered(x_m: np.ndarray, y_m: np.ndarray) -> np.ndarray:
    """Plants of 6 cm every 20 cm both ways, in no row."""
    return np.hypot((x_m % 0.2) - 0.1, (y_m % 0.2) - 0.1) <= 0.03


def nowhere(x_m: np.ndarray, y_m: np.ndarray) -> np.ndarray:
    return np.zeros_like(x_m, dtype=bool)


def drive(watch: CropWatch, is_crop: Place, is_weed: Place, since_m: float = 0.0) -> float:
    """Drive 3 m along the first row; return the way to the fault, infinite without one."""
    for step in range(60):
        pose = Pose2(since_m + 0.05 * step, 0.02, 0.03)
        watch.look(cover(pose, is_crop, is_weed), pose, ROWS)
        if watch.fault:
            return 0.05 * step
    return math.inf


def test_a_row_of_plants_that_are_called_weed_is_a_crop_that_the_network_does_not_know() -> None:
    watch = CropWatch()
    assert drive(watch, nowhere, in_rows) <= 1.0
    fault = watch.fault
    assert fault is not None
    assert (fault.share_ratio, fault.row) == (0.0, 1) and 1.0 <= fault.way_m < 2.0


@pytest.mark.parametrize("aside_m", [-0.2, 0.15])
def test_a_row_that_stands_beside_its_line_is_found_by_its_plants(aside_m: float) -> None:
    assert drive(CropWatch(), nowhere, lambda x, y: in_rows(x, y, aside_m)) <= 1.0


def test_a_crop_that_is_called_crop_is_known_whatever_grows_beside_it() -> None:
    watch = CropWatch()
    assert drive(watch, in_rows, lambda x, y: scattered(x, y) & ~in_rows(x, y)) == math.inf


def test_weeds_that_stand_in_no_row_say_nothing_of_the_crop() -> None:
    assert drive(CropWatch(), nowhere, scattered) == math.inf


def test_bare_ground_and_cameras_that_tell_no_weeds_say_nothing() -> None:
    assert drive(CropWatch(), nowhere, nowhere) == math.inf
    watch, pose = CropWatch(), Pose2(1.0, 0.0, 0.0)
    untold = cover(pose, nowhere, in_rows)
    watch.look(msgspec.structs.replace(untold, weed=b""), pose, ROWS)
    assert watch.fault is None


def test_the_fault_lasts_until_the_network_agrees_with_the_rows() -> None:
    watch = CropWatch()
    drive(watch, nowhere, in_rows)
    assert drive(watch, nowhere, nowhere, since_m=4.0) == 0.0
    for step in range(40):
        pose = Pose2(7.0 + 0.05 * step, 0.0, 0.0)
        watch.look(cover(pose, in_rows, nowhere), pose, ROWS)
    assert watch.fault is None


def test_a_person_may_decide_to_spray_all_the_same() -> None:
    watch = CropWatch()
    drive(watch, nowhere, in_rows)
    watch.accept()
    assert drive(watch, nowhere, in_rows, since_m=3.0) == math.inf
