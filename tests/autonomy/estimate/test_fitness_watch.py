from __future__ import annotations

from agribot.autonomy.estimate.witnesses.fitness_watch import PICTURES, FitnessWatch
from agribot.core.fact_text import render
from agribot.core.facts import AnyFact, PictureUnfit, TooDark
from agribot.core.messages import Scene

DARK = TooDark()


def hear(watch: FitnessWatch, *unfit: AnyFact | None) -> PictureUnfit | None:
    for index, fact in enumerate(unfit):
        watch.hear(
            Scene(
                t_s=0.1 * index, ready_s=0.0, frame_index=index, plants=(), view_body_m=(),
                unfit=render(fact), unfit_fact=fact,
            )
        )  # fmt: skip
    return watch.fault


def test_three_unfit_pictures_in_a_row_are_a_fault_and_three_fit_ones_end_it() -> None:
    watch = FitnessWatch()
    assert hear(watch, *[DARK] * (PICTURES - 1)) is None
    assert hear(watch, DARK) == PictureUnfit(cause=DARK)
    assert hear(watch, *[None] * (PICTURES - 1)) == PictureUnfit(cause=DARK)
    assert hear(watch, None) is None


def test_an_earlier_recording_has_the_words_alone() -> None:
    watch = FitnessWatch()
    for _ in range(PICTURES):
        watch.hear(
            Scene(t_s=0.0, ready_s=0.0, frame_index=0, plants=(), view_body_m=(), unfit="too dark")
        )
    assert watch.fault == PictureUnfit("too dark")


def test_single_unfit_pictures_are_none() -> None:
    assert hear(FitnessWatch(), *[DARK, DARK, None] * 20) is None
