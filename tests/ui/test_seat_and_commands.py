from __future__ import annotations

import pytest
from websockets.exceptions import ConnectionClosed

from agribot.ui.seat import SILENCE_S, Seat
from tests.ui.client import Page
from tests.ui.conftest import Robot


def test_only_the_holder_of_the_seat_drives(robot: Robot, page: Page) -> None:
    page.send(k="drive", seq=1, v=0.2, w=0.0)
    page.take_seat()
    page.send(k="drive", seq=2, v=0.3, w=0.1)
    order = robot.wait_for(lambda order: order["c"] == "drive" and order["v"] != 0.0)
    assert (order["v"], order["w"]) == (0.3, 0.1)


def test_a_second_page_sees_who_drives_and_cannot(robot: Robot, page: Page) -> None:
    page.send(k="name", name="Ada")
    page.take_seat()
    with Page(robot.port, tab="two") as other:
        hello = other.receive("hello")
        assert (hello["seat"], hello["holder"]) == ("other", "Ada")
        answer = other.ask(k="take", id=1)
        assert not answer["ok"]
        assert "Ada" in answer["reason"]
        assert not other.ask(k="mission", id=2, action="pause")["ok"]


def test_taking_over_on_purpose_stops_what_the_other_drove(robot: Robot, page: Page) -> None:
    page.take_seat()
    page.send(k="drive", seq=1, v=0.2, w=0.0)
    robot.wait_for(lambda order: order["c"] == "drive" and order["v"] == 0.2)
    with Page(robot.port, tab="two") as other:
        assert other.ask(k="take", id=1, force=True)["ok"]
        robot.wait_for(lambda _: robot.of_kind("drive")[-1]["v"] == 0.0)
        assert page.receive("seat")["seat"] in {"you", "other"}
        page.send(k="drive", seq=2, v=0.2, w=0.0)
        assert not page.ask(k="mission", id=9, action="pause")["ok"]
        assert robot.of_kind("drive")[-1]["v"] == 0.0


def test_a_page_that_is_loaded_again_has_its_seat_back(robot: Robot, page: Page) -> None:
    page.take_seat()
    cookie = {"Cookie": "nothing=1"}
    with Page(robot.port, tab="one", additional_headers=cookie) as stranger:
        assert stranger.receive("hello")["seat"] == "other", "the tab's name alone is no key"


def test_everybody_may_stop_without_the_seat(robot: Robot, page: Page) -> None:
    page.take_seat()
    with Page(robot.port, tab="two") as other:
        other.send(k="stop")
        order = robot.wait_for(lambda order: order.get("action") == "stop")
    assert order["c"] == "event"


def test_clearing_a_stop_needs_the_seat(robot: Robot, page: Page) -> None:
    assert not page.ask(k="clear_stop", id=1)["ok"]
    page.take_seat()
    assert page.ask(k="clear_stop", id=2)["ok"]
    robot.wait_for(lambda order: order.get("action") == "clear_stop")


def test_a_page_that_goes_away_while_driving_lets_go(robot: Robot) -> None:
    with Page(robot.port, tab="three") as page:
        page.take_seat()
        page.send(k="drive", seq=1, v=0.2, w=0.0)
        robot.wait_for(lambda order: order["c"] == "drive" and order["v"] == 0.2)
    robot.wait_for(lambda order: order["c"] == "drive" and robot.of_kind("drive")[-1]["v"] == 0.0)


def test_an_operator_who_stays_silent_is_reported_lost(robot: Robot) -> None:
    with Page(robot.port, tab="four") as page:
        page.take_seat()
    robot.wait_for(lambda order: order["c"] == "lost")


def test_speed_is_limited_by_the_scale_and_by_the_robot(robot: Robot, page: Page) -> None:
    page.take_seat()
    assert page.ask(k="scale", id=1, value=0.2)["ok"]
    page.send(k="drive", seq=1, v=50.0, w=-50.0)
    order = robot.wait_for(lambda order: order["c"] == "drive" and order["v"] != 0.0)
    assert 0.0 < order["v"] <= 0.2
    assert -0.25 <= order["w"] < 0.0


def test_marks_and_clicked_points_go_into_the_recording(robot: Robot, page: Page) -> None:
    page.send(k="mark", text="a stone")
    page.send(k="point", id=1, x=1.5, y=-2.0)
    robot.wait_for(lambda order: order.get("action") == "mark" and order["text"] == "a stone")
    robot.wait_for(lambda order: "East 1.500 m, North -2.000 m" in order.get("text", ""))


def test_a_drawn_polygon_goes_into_the_recording(robot: Robot, page: Page) -> None:
    assert page.ask(k="shape", id=1, what="polygon", xy=[[0, 0], [2.5, 0], [2.5, -1]])["ok"]
    robot.wait_for(
        lambda order: (
            "polygon (East North, m): 0.00 0.00, 2.50 0.00, 2.50 -1.00" in order.get("text", "")
        )
    )


def test_an_unknown_order_is_refused_with_a_reason(page: Page) -> None:
    page.take_seat()
    for action in ("fly", "note", "plan", "goto"):
        answer = page.ask(k="mission", action=action, id=5)
        assert not answer["ok"]
        assert action in answer["reason"]


@pytest.mark.parametrize(("verdict", "ok"), [("goal refused: beyond the fence", False), ("", True)])
def test_a_goal_is_answered_with_what_the_mission_makes_of_it(
    robot: Robot, page: Page, verdict: str, ok: bool
) -> None:
    goal = {"k": "goto", "x": 1.0, "y": 2.0, "yaw": 0.5}
    assert "seat" in page.ask(id=1, **goal)["reason"]
    page.take_seat()
    page.send(id=2, **goal)
    asked = robot.wait_for(lambda order: order.get("name") == "request")
    assert asked["values"]["action"] == "goto"
    assert asked["values"]["numbers"] == [1.0, 2.0, 0.5]
    robot.say({"k": "reply", "number": asked["number"], "value": verdict})
    answer = page.receive("ack")
    assert (answer["id"], answer["ok"], answer["reason"]) == (2, ok, verdict)


def test_a_recording_is_begun_and_ended_by_operators_without_the_seat(
    robot: Robot, page: Page
) -> None:
    for action in ("start", "stop"):
        assert page.ask(k="record", action=action, id=action)["ok"]
        robot.wait_for(lambda order: order.get("action") == f"{action}_recording")  # noqa: B023


@pytest.mark.parametrize(
    "text",
    [
        "{",
        "[]",
        '{"k": 3}',
        '{"k": "no such"}',
        '{"k":"drive"}',
        '{"k":"shape","what":"route","xy":[[1]]}',
        '{"k":"point","x":0,"y":-1' + 400 * "0" + "}",
    ],
)
def test_a_malformed_message_costs_the_line_and_nothing_else(robot: Robot, text: str) -> None:
    with Page(robot.port, tab="broken") as broken:
        broken.line.send(text)
        assert broken.receive("bye")["reason"]
        with pytest.raises(ConnectionClosed):
            broken.receive("never")
    with Page(robot.port) as page:
        assert page.receive("hello")["role"] == "operator"


@pytest.mark.parametrize("number", ["NaN", "Infinity", "1e999", '"1"', "true", "null", 400 * "9"])
def test_a_drive_request_that_is_no_number_never_reaches_the_robot(
    robot: Robot, number: str
) -> None:
    with Page(robot.port, tab="numbers") as page:
        page.take_seat()
        page.line.send(f'{{"k":"drive","seq":1,"v":{number},"w":0}}')
        assert page.receive("bye")["reason"]
    assert not [order for order in robot.of_kind("drive") if order["v"]]


def test_the_seat_is_free_after_silence_and_its_owner_gets_it_back_before() -> None:
    seat = Seat()
    assert seat.take("a", "Ada", 0.0) == ""
    assert "Ada" in seat.take("b", "Bob", SILENCE_S)
    seat.heard("a", SILENCE_S)
    assert "Ada" in seat.take("b", "Bob", 2 * SILENCE_S)
    assert seat.seen_by("a", 100.0) == "you"
    assert seat.seen_by("b", 100.0) == "free"
    assert seat.take("b", "Bob", 100.0) == ""
    assert seat.seen_by("a", 100.0) == "other"


def test_a_pose_by_hand_needs_the_seat_and_a_robot_at_rest(robot: Robot, page: Page) -> None:
    pose = {"k": "pose_estimate", "x": 1.0, "y": 2.0, "yaw": 0.5}
    assert "seat" in page.ask(id=1, **pose)["reason"]
    page.take_seat()
    robot.say({"k": "s", "n": 1, "t": 1.0, "mode": "mission", "vel": [0.4, 0.0]})
    page.receive("s")
    assert "drives" in page.ask(id=2, **pose)["reason"]
    robot.say({"k": "s", "n": 2, "t": 2.0, "mode": "paused", "vel": [0.0, 0.0]})
    page.receive("s")
    assert page.ask(id=3, **pose)["ok"]
    order = robot.wait_for(lambda o: o.get("action") == "pose_estimate")
    assert order["numbers"] == [1.0, 2.0, 0.5, 0.3, 0.1]
