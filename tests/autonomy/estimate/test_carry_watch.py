"""A robot that is carried or pushed aside is distinguished from one whose wheels slip."""

from __future__ import annotations

import msgspec
import pytest

from agribot.autonomy.estimate.localizer import Localizer
from agribot.autonomy.estimate.witnesses.carry_watch import CarryWatch
from agribot.autonomy.estimate.witnesses.spin_watch import SpinWatch
from agribot.core.config import EstimateConfig, FieldConfig
from agribot.core.facts import RobotCarried
from agribot.core.messages import ControlMission, Estimate, SensorBatch
from tests.asking import ask
from tests.autonomy.estimate.noisy_rover import M8N, RTK, Errors, Recording, record
from tests.autonomy.estimate.paper_robot import robot
from tests.autonomy.estimate.playback import batches
from tests.autonomy.estimate.test_soft_turns import let_float

START = (1.0, 2.0, 1.5707963)
BEGIN_S = 15.0


def localizer() -> Localizer:
    field = FieldConfig(start_map_m=START[:2], start_yaw_deg=90.0)
    return Localizer(EstimateConfig(), field, robot((0.0, 0.0, 0.6)))


def drive(t_s: float) -> tuple[float, float]:
    return (0.4, 0.0) if t_s > 3.0 else (0.0, 0.0)


def carried(errors: Errors, to_left_m: float) -> Recording:
    """Hands lift a robot that drives, and its wheels turn on in the air."""
    to_left_mps = 0.8 if to_left_m > 0.0 else -0.8

    def is_in_hands(t_s: float) -> bool:
        return BEGIN_S < t_s < BEGIN_S + to_left_m / to_left_mps

    return record(
        drive, 20.0, seed=1, errors=errors, start=START,
        slide_mps=lambda t_s: to_left_mps if is_in_hands(t_s) else 0.0,
        grip=lambda t_s: 0.0 if is_in_hands(t_s) else 1.0,
    )  # fmt: skip


@pytest.mark.parametrize("is_left", [True, False])
@pytest.mark.parametrize(
    ("kind", "carried_m"), [("fixed", 0.6), ("float", 0.4), ("without corrections", 1.2)]
)
def test_a_robot_that_is_carried_aside_is_told_soon_with_any_receiver(
    kind: str, carried_m: float, *, is_left: bool
) -> None:
    errors = M8N if kind == "without corrections" else RTK
    recording = carried(errors, carried_m if is_left else -carried_m)
    if kind == "float":
        fixes = [(t_s, let_float(fix) if t_s > 14.0 else fix) for t_s, fix in recording.fixes]
        recording = msgspec.structs.replace(recording, fixes=fixes)
    into = localizer()
    estimates = [into.update(batch) for batch in batches(recording)]
    told = [e for e in estimates if e.contradiction_fact]
    assert not any("wheels" in e.verdicts for e in estimates)
    assert BEGIN_S < told[0].t_s < BEGIN_S + 1.8
    side = "left" if is_left else "right"
    first = told[0].contradiction_fact
    assert isinstance(first, RobotCarried) and first.moved == side
    assert "robot" in (told[-1].contradiction_fact or first).parts


def resume(into: Localizer, batch: SensorBatch) -> Estimate:
    """Bid it go on at this time, and look at the tick after."""
    event = ask(ControlMission(action="resume"), "page", t_s=batch.t_s)
    end = msgspec.structs.replace(batch, t_s=batch.t_s + 0.02, requests=(event,))
    into.update(end)
    return into.update(msgspec.structs.replace(end, requests=()))


def test_whoever_resumes_it_has_looked_unless_there_was_no_time_to_read_the_question() -> None:
    into = localizer()
    playing = iter(batches(carried(RTK, 0.4)))
    hasty = next(batch for batch in playing if into.update(batch).contradiction_fact is not None)
    still = resume(into, hasty).contradiction_fact
    assert still is not None and "robot" in still.parts
    for batch in playing:
        last = into.update(batch)
    assert last.contradiction_fact is not None and "robot" in last.contradiction_fact.parts
    assert resume(into, batch).contradiction_fact is None


def test_wheels_that_slip_and_a_clod_that_throws_the_robot_are_no_hands() -> None:
    watch = CarryWatch()
    for tick in range(200):
        aside_mps = 0.4 if tick % 40 == 0 else 0.1
        watch.add(tick / 10.0, 0.1, (0.05, aside_mps), (0.4, 0.1), 0.03)
    assert watch.find() is None


def test_a_push_ahead_of_its_wheels_is_told_and_velocities_that_scatter_tell_nothing() -> None:
    for std_mps, moved in ((0.03, "ahead"), (0.3, None)):
        watch = CarryWatch()
        for tick in range(10):
            watch.add(tick / 10.0, 0.1, (0.6, 0.0), (0.0, 0.0), std_mps)
        found = watch.find()
        assert (found and found.moved) == moved


def test_a_robot_whose_heading_may_be_wrong_is_carried_only_where_it_outruns_its_wheels() -> None:
    for shown_mps, moved in (((0.2, 0.35), None), ((0.2, 1.0), "left")):
        watch = CarryWatch()
        for tick in range(10):
            watch.add(tick / 10.0, 0.1, shown_mps, (0.4, 0.0), 0.03)
        found = watch.find(is_heading_sure=False)
        assert watch.find() is not None
        assert (found and found.moved) == moved


@pytest.mark.parametrize(("claimed_mps", "spins"), [(0.4, True), (0.01, False)])
def test_wheels_that_stand_do_not_spin_where_the_antenna_moves(
    claimed_mps: float, *, spins: bool
) -> None:
    watch = SpinWatch(8)
    found = [watch.is_spinning(claimed_mps, (-0.4, 0.0), 0.05) for _ in range(20)]
    assert any(found) == spins
