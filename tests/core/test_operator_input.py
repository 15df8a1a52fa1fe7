from __future__ import annotations

import threading

from agribot.core.messages import INBOX_LIMIT, Inbox, OperatorEvent


def test_what_is_posted_comes_out_once_with_the_time_of_the_tick() -> None:
    inbox = Inbox()
    inbox.post(OperatorEvent(t_s=99.0, action="pause", source="page"))
    inbox.drive(0.3, -0.1, "gamepad")
    events, hand = inbox.drain(5.0)
    assert [(event.t_s, event.action, event.source) for event in events] == [(5.0, "pause", "page")]
    assert [(h.t_s, h.v_mps, h.yaw_rate_radps, h.source) for h in hand] == [
        (5.0, 0.3, -0.1, "gamepad")
    ]
    assert inbox.drain(5.02) == ((), ())


def test_of_many_drive_requests_only_the_newest_counts() -> None:
    inbox = Inbox()
    for speed in range(100):
        inbox.drive(float(speed), 0.0, "flood")
    _, hand = inbox.drain(1.0)
    assert [request.v_mps for request in hand] == [99.0]


def test_a_stop_survives_a_flood_and_comes_last_so_that_it_wins() -> None:
    inbox = Inbox()
    inbox.post(OperatorEvent(t_s=0.0, action="stop"))
    for _ in range(3 * INBOX_LIMIT):
        inbox.post(OperatorEvent(t_s=0.0, action="clear_stop"))
    events, _ = inbox.drain(1.0)
    assert len(events) == INBOX_LIMIT + 1
    assert events[-1].action == "stop"


def test_many_threads_may_post_while_the_platform_drains() -> None:
    inbox = Inbox()

    def flood() -> None:
        for _ in range(100):
            inbox.post(OperatorEvent(t_s=0.0, action="pause"))

    threads = [threading.Thread(target=flood) for _ in range(8)]
    for thread in threads:
        thread.start()
    seen = 0
    while any(thread.is_alive() for thread in threads):
        seen += len(inbox.drain(0.0)[0])
    seen += len(inbox.drain(0.0)[0])
    assert seen == 800
