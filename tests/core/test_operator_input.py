from __future__ import annotations

import threading

from agribot.core.messages import (
    INBOX_LIMIT,
    ClearStop,
    ControlMission,
    HandDrive,
    Inbox,
    PressStop,
    RequestEvent,
    Who,
)


def test_what_is_posted_comes_out_once_with_the_time_of_the_tick() -> None:
    inbox = Inbox()
    inbox.post(ControlMission(action="pause"), Who("page"))
    inbox.drive(0.3, -0.1, Who("gamepad"))
    events, hand = inbox.drain(5.0)
    pause = ControlMission(action="pause")
    assert events == (RequestEvent(t_s=5.0, who=Who("page"), request=pause),)
    assert hand == (HandDrive(t_s=5.0, v_mps=0.3, yaw_rate_radps=-0.1, who=Who("gamepad")),)
    assert inbox.drain(5.02) == ((), ())


def test_of_many_drive_requests_only_the_newest_counts() -> None:
    inbox = Inbox()
    for speed in range(100):
        inbox.drive(float(speed), 0.0, Who("flood"))
    _, hand = inbox.drain(1.0)
    assert [request.v_mps for request in hand] == [99.0]


def test_a_stop_survives_a_flood_and_comes_last_so_that_it_wins() -> None:
    inbox = Inbox()
    inbox.post(PressStop())
    for _ in range(3 * INBOX_LIMIT):
        inbox.post(ClearStop())
    events, _ = inbox.drain(1.0)
    assert len(events) == INBOX_LIMIT + 1
    assert events[-1].request == PressStop()


def test_many_threads_may_post_while_the_platform_drains() -> None:
    inbox = Inbox()

    def flood() -> None:
        for _ in range(100):
            inbox.post(ControlMission(action="pause"))

    threads = [threading.Thread(target=flood) for _ in range(8)]
    for thread in threads:
        thread.start()
    seen = 0
    while any(thread.is_alive() for thread in threads):
        seen += len(inbox.drain(0.0)[0])
    seen += len(inbox.drain(0.0)[0])
    assert seen == 800
