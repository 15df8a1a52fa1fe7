"""Requests in words, for logs and notes."""

from __future__ import annotations

from collections.abc import Iterable

from agribot.core.messages.requests import (
    AddNote,
    AnyRequest,
    ChangeSetting,
    CorrectPose,
    DrawShape,
    GoTo,
    MarkMoment,
    PointOut,
    Visit,
)


def describe_request(request: AnyRequest) -> str:
    """Return what a request asks for in one line."""
    match request:
        case GoTo():
            return f"goto {_list_numbers(request.place)}"
        case Visit():
            return f"visit {_list_numbers(sum(request.places_map_m, ()))}"
        case CorrectPose():
            return f"pose_estimate {_list_numbers(request.pose)}"
        case ChangeSetting():
            return f"sets {request.setting} = {request.value:g}"
        case AddNote():
            return request.text
        case _:
            return _describe_shown(request)


def _describe_shown(request: AnyRequest) -> str:
    match request:
        case MarkMoment():
            return request.text or "marked"
        case PointOut():
            return f"point: East {request.x_map_m:.3f} m, North {request.y_map_m:.3f} m"
        case DrawShape():
            places = ", ".join(f"{x_m:.2f} {y_m:.2f}" for x_m, y_m in request.corners_map_m)
            return f"{request.shape} (East North, m): {places}"
        case _:
            return request.word


def _list_numbers(numbers: Iterable[float]) -> str:
    return ", ".join(f"{number:.3f}" for number in numbers)
