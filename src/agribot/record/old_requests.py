"""Requests of recordings from before they were tagged: one struct for all, and names without kind.

What text, value and numbers meant depended on the action.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import msgspec

from agribot.core.facts import AnyFact, DeviceSaid, DeviceWell, Part, Said, join_facts
from agribot.core.messages import (
    AddNote,
    AnyRequest,
    AskerKind,
    BoardSample,
    ChangeSetting,
    ClearStop,
    ContactorSample,
    ControlMission,
    ControlRecording,
    CorrectPose,
    DeviceNote,
    DrawShape,
    GoTo,
    MapPoint,
    MarkMoment,
    PointOut,
    PressStop,
    RequestEvent,
    StopFor,
    TakePlan,
    TickRecord,
    Visit,
    Who,
)
from agribot.core.messages.requests import find_live_setting

NO_NUMBER = (math.nan,) * 5  # numbers of a goal or a pose that has none, which the robot refuses


class _OldEvent(msgspec.Struct):
    t_s: float
    action: str
    source: str = ""
    text: str = ""
    value: float = 0.0
    numbers: tuple[float, ...] = ()
    id: str = ""
    parts: tuple[Part, ...] = ()
    fact: AnyFact | None = None


class _OldHand(msgspec.Struct):
    source: str | None = None


class _OldBoard(msgspec.Struct):
    stopped: str = ""
    faults: tuple[str, ...] = ()
    fault_parts: tuple[Part, ...] = ()


class _OldContactor(msgspec.Struct):
    trouble: str = ""


class _OldBatch(msgspec.Struct):
    events: tuple[_OldEvent, ...] = ()
    hand: tuple[_OldHand, ...] = ()
    board: tuple[_OldBoard, ...] = ()
    contactor: tuple[_OldContactor, ...] = ()


class _OldTick(msgspec.Struct):
    batch: _OldBatch


# Keys of a MessagePack map that no tick of today has, or has elsewhere only.
_OLD_KEYS = (b"\xa6events", b"\xa6source", b"\xabfault_parts", b"\xa7trouble")
_DECODER = msgspec.msgpack.Decoder(_OldTick)


def lift_requests(record: TickRecord, data: bytes) -> TickRecord:
    """Return a tick with the requests and the notes on devices that an old one has in its bytes."""
    if not any(key in data for key in _OLD_KEYS):
        return record
    old = _DECODER.decode(data).batch
    notes = [_lift_note(event) for event in old.events if event.action == "sensor"]
    lifted = [event for old_one in old.events for event in _lift_event(old_one)]
    hand = [
        now if was.source is None else msgspec.structs.replace(now, who=_lift_name(was.source))
        for was, now in zip(old.hand, record.batch.hand, strict=True)
    ]
    batch = msgspec.structs.replace(
        record.batch, requests=(*record.batch.requests, *lifted),
        notes=(*record.batch.notes, *notes), hand=tuple(hand),
        board=tuple(map(_lift_board, old.board, record.batch.board)),
        contactor=tuple(map(_lift_contactor, old.contactor, record.batch.contactor)),
    )  # fmt: skip
    return msgspec.structs.replace(record, batch=batch)


def _lift_name(name: str) -> Who:
    return Who(name, AskerKind.UNKNOWN)


def _lift_board(was: _OldBoard, now: BoardSample) -> BoardSample:
    stop = now.stop or (Said(was.stopped) if was.stopped else None)
    parts: tuple[Part, ...] = was.fault_parts or ("motors",)
    faults = [DeviceSaid(said, parts) for said in was.faults]
    return msgspec.structs.replace(now, stop=stop, fault=now.fault or join_facts(faults))


def _lift_contactor(was: _OldContactor, now: ContactorSample) -> ContactorSample:
    fault = now.fault or (DeviceSaid(was.trouble, ("contactor",)) if was.trouble else None)
    return msgspec.structs.replace(now, fault=fault)


def _lift_note(event: _OldEvent) -> DeviceNote:
    is_fault = event.value != 0.0
    fact = DeviceSaid(event.text, event.parts) if is_fault else DeviceWell(event.text)
    return DeviceNote(t_s=event.t_s, fact=fact)


def _lift_event(event: _OldEvent) -> list[RequestEvent]:
    make = _MAKERS.get(event.action)
    request = make(event) if make is not None else _make_control(event)
    if request is None:
        return []
    request = msgspec.structs.replace(request, id=event.id)
    return [RequestEvent(t_s=event.t_s, who=_lift_name(event.source), request=request)]


def _make_control(event: _OldEvent) -> AnyRequest | None:
    """Make what only its action says; None of what is no request."""
    try:
        return msgspec.convert({"kind": "control_mission", "action": event.action}, ControlMission)
    except msgspec.ValidationError:
        return None


def _make_stop(event: _OldEvent) -> AnyRequest:
    said = Said(event.text, event.source) if event.text else None
    cause = event.fact or said
    return PressStop() if cause is None else StopFor(cause=cause)


def _make_goal(event: _OldEvent) -> AnyRequest:
    if len(event.numbers) not in (2, 3):
        return GoTo(x_map_m=math.nan, y_map_m=math.nan)
    x_m, y_m, *yaw = event.numbers
    return GoTo(x_map_m=x_m, y_map_m=y_m, yaw_map_rad=yaw[0] if yaw else None)


def _make_visit(event: _OldEvent) -> AnyRequest:
    places = _list_places(event.numbers) if len(event.numbers) % 2 == 0 else ()
    return Visit(places_map_m=places, title=event.text)


def _list_places(numbers: tuple[float, ...]) -> tuple[MapPoint, ...]:
    return tuple(zip(numbers[::2], numbers[1::2], strict=False))


def _make_setting(event: _OldEvent) -> AnyRequest | None:
    setting = find_live_setting(event.text)
    return None if setting is None else ChangeSetting(setting=setting, value=event.value)


def _make_pose(event: _OldEvent) -> AnyRequest:
    is_whole = len(event.numbers) == len(NO_NUMBER)
    x_m, y_m, yaw_rad, std_m, std_rad = event.numbers if is_whole else NO_NUMBER
    return CorrectPose(x_map_m=x_m, y_map_m=y_m, yaw_map_rad=yaw_rad, std_m=std_m, std_rad=std_rad)


def _make_point(event: _OldEvent) -> AnyRequest | None:
    places = _list_places(event.numbers)
    return PointOut(x_map_m=places[0][0], y_map_m=places[0][1]) if places else None


_MAKERS: dict[str, Callable[[_OldEvent], AnyRequest | None]] = {
    "sensor": lambda _: None,
    "stop": _make_stop,
    "clear_stop": lambda _: ClearStop(),
    "goto": _make_goal,
    "visit": _make_visit,
    "plan": lambda event: TakePlan(geojson=event.text),
    "set": _make_setting,
    "pose_estimate": _make_pose,
    "mark": lambda event: MarkMoment(text=event.text),
    "note": lambda event: AddNote(text=event.text),
    "start_recording": lambda _: ControlRecording(action="start"),
    "stop_recording": lambda _: ControlRecording(action="stop"),
    "point_out": _make_point,
    "draw_polygon": lambda event: DrawShape(
        shape="polygon", corners_map_m=_list_places(event.numbers)
    ),
    "draw_route": lambda event: DrawShape(shape="route", corners_map_m=_list_places(event.numbers)),
}
