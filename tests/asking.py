"""Requests as people and programs send them, for tests."""

from __future__ import annotations

from typing import get_args

from agribot.core.messages import (
    AddNote,
    AnyRequest,
    ClearStop,
    ControlMission,
    ControlRecording,
    GoTo,
    MarkMoment,
    MissionAction,
    PressStop,
    RequestEvent,
    RequestWord,
    Who,
)

# Those that need nothing else, by their word; a goal is where the rows begin.
BY_WORD: dict[RequestWord, AnyRequest] = {
    "stop": PressStop(),
    "clear_stop": ClearStop(),
    **{action: ControlMission(action=action) for action in get_args(MissionAction)},
    "goto": GoTo(x_map_m=0.0, y_map_m=0.0),
    "note": AddNote(text="a note"),
    "mark": MarkMoment(),
    "start_recording": ControlRecording(action="start"),
    "stop_recording": ControlRecording(action="stop"),
}


def ask(request: AnyRequest | RequestWord, by: str = "operator", t_s: float = 0.0) -> RequestEvent:
    """Make the event of a request, which may be one of BY_WORD."""
    asked = BY_WORD[request] if isinstance(request, str) else request
    return RequestEvent(t_s=t_s, who=Who(by), request=asked)


def go_to(place: tuple[float, ...], id: str = "") -> GoTo:
    """Make the request of a goal: x, y (m, map) and perhaps yaw (rad)."""
    x_m, y_m, *yaw = place
    return GoTo(x_map_m=x_m, y_map_m=y_m, yaw_map_rad=yaw[0] if yaw else None, id=id)
