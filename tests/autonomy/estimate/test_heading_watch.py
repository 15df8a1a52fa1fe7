"""A heading that jumps though nothing turned is left to a person, once it was known."""

from __future__ import annotations

import math
from collections.abc import Sequence

import pytest

from agribot.autonomy.estimate.filter.ekf import YAW
from agribot.autonomy.estimate.witnesses.heading_watch import HeadingWatch
from agribot.core.facts import HeadingJumped
from agribot.core.messages import ControlMission, SensorBatch
from tests import nightly
from tests.asking import ask
from tests.autonomy.estimate.noisy_rover import M8N, RTK, Errors, record, rows
from tests.autonomy.estimate.playback import batches, localizer, play
from tests.finding import find


@pytest.mark.parametrize("errors", [RTK, M8N], ids=["rtk", "m8n"])
@nightly.all_or_first("seeds", range(4), in_suite=1)
def test_a_robot_that_turns_at_the_ends_of_its_rows_is_never_accused(
    errors: Errors, seeds: Sequence[int]
) -> None:
    for seed in seeds:
        recording = record(rows, 60.0, seed=seed, errors=errors)
        assert not [e for e in play(recording) if e.contradiction_fact]


def test_a_heading_turned_over_at_once_is_told_until_a_person_resumes() -> None:
    recording = record(rows, 20.0, seed=1, errors=RTK)
    into = localizer()
    told = []
    for batch in batches(recording):
        estimate = into.update(batch)
        if batch.t_s == pytest.approx(8.0):
            into.pose.ekf.x[YAW] += math.radians(-98.0)
        told.append((batch.t_s, estimate.contradiction_fact))
    assert not any(fact for t_s, fact in told if t_s <= 8.0)
    jumped = find(next(fact for _, fact in told if fact), HeadingJumped)
    assert jumped.off_rad < 0.0
    resume = ask(ControlMission(action="resume"), t_s=20.0)
    assert not into.update(SensorBatch(t_s=20.02, requests=(resume,))).contradiction_fact


def test_a_heading_that_nobody_knew_yet_may_be_found_at_once() -> None:
    watch = HeadingWatch()
    for tick in range(100):
        is_found = tick > 50
        watch.add(tick / 50.0, 1.5 if is_found else 0.0, 0.05 if is_found else 0.8)
    assert not watch.fault


def test_what_a_heading_gains_slowly_is_no_jump() -> None:
    watch = HeadingWatch()
    for tick in range(500):
        watch.add(tick / 50.0, 0.2 * tick / 50.0, 0.02)
    assert not watch.fault
