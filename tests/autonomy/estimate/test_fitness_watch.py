from __future__ import annotations

from agribot.autonomy.estimate.fitness_watch import PICTURES, FitnessWatch
from agribot.core.facts import PictureUnfit
from agribot.core.messages import Scene

DARK = "picture is too dark; wait for daylight, or light the ground"


def hear(watch: FitnessWatch, *unfit: str) -> PictureUnfit | None:
    for index, reason in enumerate(unfit):
        watch.hear(
            Scene(
                t_s=0.1 * index, ready_s=0.0, frame_index=index, plants=(), view_body_m=(),
                unfit=reason,
            )
        )  # fmt: skip
    return watch.fault


def test_three_unfit_pictures_in_a_row_are_a_fault_and_three_fit_ones_end_it() -> None:
    watch = FitnessWatch()
    assert hear(watch, *[DARK] * (PICTURES - 1)) is None
    assert hear(watch, DARK) == PictureUnfit(DARK)
    assert hear(watch, *[""] * (PICTURES - 1)) == PictureUnfit(DARK)
    assert hear(watch, "") is None


def test_single_unfit_pictures_are_none() -> None:
    assert hear(FitnessWatch(), *[DARK, DARK, ""] * 20) is None
