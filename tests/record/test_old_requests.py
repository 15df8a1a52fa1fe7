"""Recordings from before requests were tagged are read as what was asked then."""

from __future__ import annotations

import math
from typing import Any

import msgspec
import pytest

from agribot.core.facts import Both, DeviceSaid, DeviceWell, Disarmed, Said
from agribot.core.messages import (
    AddNote,
    AnyRequest,
    AskerKind,
    ChangeSetting,
    ClearStop,
    ControlMission,
    ControlRecording,
    CorrectPose,
    DeviceNote,
    DrawShape,
    GoTo,
    MarkMoment,
    PointOut,
    PressStop,
    RequestEvent,
    SensorBatch,
    StopFor,
    TakePlan,
    Visit,
    Who,
)
from agribot.record.ticks import decode_tick, encode_tick
from tests.record import record_samples as samples


def read_old(events: list[dict[str, Any]], hand: list[dict[str, Any]]) -> SensorBatch:
    """Read a tick whose batch has these events and requests of a hand."""
    tick = msgspec.msgpack.decode(encode_tick(samples.ticks(1)[0]))
    del tick["batch"]["requests"], tick["batch"]["notes"]
    tick["batch"] |= {"events": events, "hand": hand}
    return decode_tick(msgspec.msgpack.encode(tick)).batch


def read_event(**fields: Any) -> SensorBatch:
    return read_old([{"t_s": 1.0, "source": "Ada", "id": "7", **fields}], [])


SQUARE = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0))
PLACES: list[float] = [value for place in SQUARE for value in place]


@pytest.mark.parametrize(
    ("old", "request_now"),
    [
        ({"action": "pause"}, ControlMission(action="pause")),
        ({"action": "nudge_left"}, ControlMission(action="nudge_left")),
        ({"action": "clear_stop"}, ClearStop()),
        ({"action": "stop"}, PressStop()),
        ({"action": "stop", "text": "a dog"}, StopFor(cause=Said("a dog", "Ada"))),
        (
            {"action": "stop", "text": "disarmed", "fact": {"code": "disarmed"}},
            StopFor(cause=Disarmed()),
        ),
        ({"action": "goto", "numbers": [1.0, 2.0]}, GoTo(x_map_m=1.0, y_map_m=2.0)),
        (
            {"action": "goto", "numbers": [1.0, 2.0, 0.5]},
            GoTo(x_map_m=1.0, y_map_m=2.0, yaw_map_rad=0.5),
        ),
        (
            {"action": "visit", "text": "traps", "numbers": PLACES},
            Visit(title="traps", places_map_m=SQUARE),
        ),
        ({"action": "visit", "numbers": [1.0]}, Visit(places_map_m=())),
        ({"action": "plan", "text": "{}"}, TakePlan(geojson="{}")),
        (
            {"action": "set", "text": "treatment.enabled", "value": 1.0},
            ChangeSetting(setting="treatment.enabled", value=1.0),
        ),
        (
            {"action": "pose_estimate", "numbers": [1.0, 2.0, 0.5, 0.3, 0.1]},
            CorrectPose(x_map_m=1.0, y_map_m=2.0, yaw_map_rad=0.5),
        ),
        ({"action": "mark", "text": "wet"}, MarkMoment(text="wet")),
        ({"action": "note", "text": "wet"}, AddNote(text="wet")),
        ({"action": "stop_recording"}, ControlRecording(action="stop")),
        ({"action": "point_out", "numbers": [1.0, 2.0]}, PointOut(x_map_m=1.0, y_map_m=2.0)),
        (
            {"action": "draw_polygon", "numbers": PLACES},
            DrawShape(shape="polygon", corners_map_m=SQUARE),
        ),
        (
            {"action": "draw_route", "numbers": PLACES},
            DrawShape(shape="route", corners_map_m=SQUARE),
        ),
    ],
)
def test_what_was_asked_keeps_its_meaning_its_asker_and_its_id(
    old: dict[str, Any], request_now: AnyRequest
) -> None:
    request_now = msgspec.structs.replace(request_now, id="7")
    who = Who("Ada", AskerKind.UNKNOWN)
    event = RequestEvent(t_s=1.0, who=who, request=request_now)
    assert read_event(**old).requests == (event,)


@pytest.mark.parametrize("old", [{"action": "set", "text": "seed"}, {"action": "fly"}])
def test_what_moved_nothing_is_left_out(old: dict[str, Any]) -> None:
    assert read_event(**old).requests == ()


def test_a_goal_or_a_pose_that_had_too_few_numbers_is_refused_again() -> None:
    (goal,) = read_event(action="goto", numbers=[1.0]).requests
    (pose,) = read_event(action="pose_estimate", numbers=[1.0]).requests
    assert isinstance(goal.request, GoTo) and isinstance(pose.request, CorrectPose)
    assert all(map(math.isnan, (*goal.request.place, *pose.request.pose)))


def test_notes_on_sensors_become_notes_on_devices_whatever_a_person_is_called() -> None:
    silent = {"action": "sensor", "text": "gnss is silent", "value": 1.0, "parts": ["gnss"]}
    batch = read_old(
        [
            {"t_s": 1.0, "source": "sensors", **silent},
            {"t_s": 2.0, "source": "sensors", "action": "sensor", "text": "gnss is heard again"},
            {"t_s": 2.0, "source": "sensors", "action": "stop"},
        ],
        [],
    )
    assert batch.notes == (
        DeviceNote(t_s=1.0, fact=DeviceSaid("gnss is silent", ("gnss",))),
        DeviceNote(t_s=2.0, fact=DeviceWell("gnss is heard again")),
    )
    assert [event.request for event in batch.requests] == [PressStop()]


def test_a_hand_keeps_its_name() -> None:
    hand = {"t_s": 1.0, "v_mps": 0.2, "yaw_rate_radps": 0.0, "source": "Ada"}
    (driven,) = read_old([], [hand]).hand
    assert (driven.v_mps, driven.who) == (0.2, Who("Ada", AskerKind.UNKNOWN))


def test_a_recording_of_today_is_read_as_it_was_written() -> None:
    for record in samples.ticks(10):
        again = decode_tick(encode_tick(record)).batch
        assert (again.requests, again.hand) == (record.batch.requests, record.batch.hand)


def test_words_of_boards_and_contactors_stop_the_robot_as_they_did() -> None:
    tick = msgspec.msgpack.decode(encode_tick(samples.ticks(1)[0]))
    tick["batch"]["board"] = [
        {"t_s": 1.0, "stopped": "it hung", "faults": ["a", "b"], "fault_parts": ["wheels"]},
        {"t_s": 2.0, "stopped": "", "faults": [], "fault_parts": []},
    ]
    tick["batch"]["contactor"] = [{"t_s": 1.0, "trouble": "its line is lost"}, {"t_s": 2.0}]
    batch = decode_tick(msgspec.msgpack.encode(tick)).batch
    bad, well = batch.board
    assert (bad.stop, well.stop, well.fault) == (Said("it hung"), None, None)
    assert bad.fault == Both(DeviceSaid("a", ("wheels",)), DeviceSaid("b", ("wheels",)))
    assert [sample.fault for sample in batch.contactor] == [
        DeviceSaid("its line is lost", ("contactor",)), None,
    ]  # fmt: skip
