"""How many pages may be connected, and who gives way: viewers never keep an operator out."""

from __future__ import annotations

from agribot.ui.server.access import Caller
from agribot.ui.server.hub import Hub
from agribot.ui.server.seat import SILENCE_S

MAX_PAGES = 64
MAX_VIEWERS = 40  # limit of viewers; the rest is for operators


def make_room(hub: Hub, caller: Caller, now_s: float) -> str:
    """Return why there is no room for another page; "" where there is.

    When all places are taken, an operator gets that of the operator's page that was silent for
    longest, never that of the seat. The holder of the seat gets one even where all are lively.
    """
    total = len(hub.sockets)
    if caller.role != "operator":
        viewers = sum(page.role != "operator" for page in hub.sockets)
        is_full = viewers >= MAX_VIEWERS or total >= MAX_PAGES
        return f"{viewers} pages look on already; close one of them" if is_full else ""
    if total < MAX_PAGES:
        return ""
    others = [p for p in hub.sockets if p.role == "operator" and p.session != hub.seat.holder]
    has_seat = bool(caller.session) and hub.seat.holder.partition("/")[0] == caller.session
    quiet = min(others, key=lambda page: page.heard_s, default=None)
    if quiet is None or (not has_seat and now_s - quiet.heard_s <= SILENCE_S):
        return f"{total} pages are connected already; close one of them"
    hub.sockets.discard(quiet)
    quiet.cut()
    return ""
