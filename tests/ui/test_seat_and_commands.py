from __future__ import annotations

import json

import msgspec
import pytest
from websockets.exceptions import ConnectionClosed

from agribot.core.facts import Said, SeatHeld
from agribot.ui import wire
from agribot.ui.server.seat import SILENCE_S, Seat
from tests.ui.client import Never, Page
from tests.ui.conftest import Robot
from tests.ui.messages import make_state


def test_only_the_holder_of_the_seat_drives(robot: Robot, page: Page) -> None:
    page.send(wire.DriveByHand(v_mps=0.2, yaw_rate_radps=0.0))
    page.take_seat()
    page.send(wire.DriveByHand(v_mps=0.3, yaw_rate_radps=0.1))
    order = robot.wait_for(wire.DriveOrder, lambda order: order.v_mps != 0.0)
    assert (order.v_mps, order.yaw_rate_radps) == (0.3, 0.1)


def test_a_second_page_sees_who_drives_and_cannot(robot: Robot, page: Page) -> None:
    page.send(wire.UseName(name="Ada"))
    page.take_seat()
    with Page(robot.port, tab="two") as other:
        hello = other.receive(wire.Hello)
        assert (hello.seat, hello.holder) == ("other", "Ada")
        answer = other.ask(wire.TakeSeat())
        assert not answer.ok
        assert "Ada" in answer.reason
        assert not other.ask(wire.ControlMission(action="pause")).ok


def test_taking_over_on_purpose_stops_what_the_other_drove(robot: Robot, page: Page) -> None:
    page.take_seat()
    page.send(wire.DriveByHand(v_mps=0.2, yaw_rate_radps=0.0))
    robot.wait_for(wire.DriveOrder, lambda order: order.v_mps == 0.2)
    with Page(robot.port, tab="two") as other:
        assert other.ask(wire.TakeSeat(force=True)).ok
        robot.wait_for(wire.DriveOrder, lambda _: robot.of_kind(wire.DriveOrder)[-1].v_mps == 0.0)
        assert page.receive(wire.SeatChange).seat in {"you", "other"}
        page.send(wire.DriveByHand(v_mps=0.2, yaw_rate_radps=0.0))
        assert not page.ask(wire.ControlMission(action="pause")).ok
        assert robot.of_kind(wire.DriveOrder)[-1].v_mps == 0.0


def test_a_page_that_is_loaded_again_has_its_seat_back(robot: Robot, page: Page) -> None:
    page.take_seat()
    cookie = {"Cookie": "nothing=1"}
    with Page(robot.port, tab="one", additional_headers=cookie) as stranger:
        assert stranger.receive(wire.Hello).seat == "other", "the tab's name alone is no key"


def test_everybody_may_stop_without_the_seat(robot: Robot, page: Page) -> None:
    page.take_seat()
    with Page(robot.port, tab="two") as other:
        other.send(wire.PressStop())
        robot.wait_for_request("stop")


def test_clearing_a_stop_needs_the_seat(robot: Robot, page: Page) -> None:
    assert not page.ask(wire.ClearStop()).ok
    page.take_seat()
    assert page.ask(wire.ClearStop()).ok
    robot.wait_for_request("clear_stop")


def test_a_page_that_goes_away_while_driving_lets_go(robot: Robot) -> None:
    with Page(robot.port, tab="three") as page:
        page.take_seat()
        page.send(wire.DriveByHand(v_mps=0.2, yaw_rate_radps=0.0))
        robot.wait_for(wire.DriveOrder, lambda order: order.v_mps == 0.2)
    robot.wait_for(wire.DriveOrder, lambda order: robot.of_kind(wire.DriveOrder)[-1].v_mps == 0.0)


def test_an_operator_who_stays_silent_is_reported_lost(robot: Robot) -> None:
    with Page(robot.port, tab="four") as page:
        page.take_seat()
    robot.wait_for(wire.OperatorLost)


def test_speed_is_limited_by_the_scale_and_by_the_robot(robot: Robot, page: Page) -> None:
    page.take_seat()
    assert page.ask(wire.ScaleSpeed(ratio=0.2)).ok
    page.send(wire.DriveByHand(v_mps=50.0, yaw_rate_radps=-50.0))
    order = robot.wait_for(wire.DriveOrder, lambda order: order.v_mps != 0.0)
    assert 0.0 < order.v_mps <= 0.2
    assert -0.25 <= order.yaw_rate_radps < 0.0


def test_marks_and_clicked_points_go_into_the_recording(robot: Robot, page: Page) -> None:
    page.send(wire.MarkMoment(text="a stone"))
    page.send(wire.PointOut(id="1", x_map_m=1.5, y_map_m=-2.0))
    robot.wait_for_request("mark", lambda order: order.text == "a stone")
    order = robot.wait_for_request("point_out")
    assert order.request == wire.PointOut(x_map_m=1.5, y_map_m=-2.0)
    assert order.who.kind == "operator"


def test_a_drawn_polygon_goes_into_the_recording(robot: Robot, page: Page) -> None:
    corners = ((0.0, 0.0), (2.5, 0.0), (2.5, -1.0))
    assert page.ask(wire.DrawShape(shape="polygon", corners_map_m=corners)).ok
    order = robot.wait_for_request("draw_polygon")
    assert order.request == wire.DrawShape(shape="polygon", corners_map_m=corners)


def test_an_unknown_order_is_refused_with_a_reason_to_who_gave_it(page: Page) -> None:
    page.take_seat()
    for number, action in enumerate(("fly", "note", "plan", "goto")):
        order = {"kind": "control_mission", "action": action, "id": f"order-{number}"}
        page.send_text(json.dumps(order))
        verdict = page.receive(wire.Verdict)
        assert (verdict.id, verdict.ok) == (f"order-{number}", False)
        assert action in verdict.reason
    assert page.ask(wire.ControlMission(action="pause")).ok, "the line is still good"


@pytest.mark.parametrize("refusal", [Said("goal refused: beyond the fence"), None])
def test_a_goal_is_answered_with_what_the_mission_makes_of_it(
    robot: Robot, page: Page, refusal: Said | None
) -> None:
    goal = wire.GoTo(id="2", x_map_m=1.0, y_map_m=2.0, yaw_map_rad=0.5)
    assert "seat" in page.ask(goal).reason
    page.take_seat()
    page.send(goal)
    id, asked = robot.wait_for_question(wire.RequestOrder)
    assert asked.request == wire.GoTo(x_map_m=1.0, y_map_m=2.0, yaw_map_rad=0.5)
    robot.say(wire.Answer(id=id, refusal=refusal))
    answer = page.receive(wire.Verdict)
    assert (answer.id, answer.ok) == ("2", refusal is None)
    assert answer.reason == (refusal.text if refusal else "")


def test_a_recording_is_begun_and_ended_by_operators_without_the_seat(
    robot: Robot, page: Page
) -> None:
    for action in ("start", "stop"):
        assert page.ask(wire.ControlRecording(action=action)).ok
        robot.wait_for_request(f"{action}_recording")


@pytest.mark.parametrize(
    "text",
    [
        "{",
        "[]",
        '{"kind": 3}',
        '{"kind": "no such"}',
        '{"kind":"drive_by_hand"}',
        '{"kind":"draw_shape","shape":"route","corners_map_m":[[1]]}',
        '{"kind":"draw_shape","shape":"route","corners_map_m":[]}',
        '{"kind":"point_out","x_map_m":0,"y_map_m":-1' + 400 * "0" + "}",
        '{"kind":"correct_pose","x_map_m":0,"y_map_m":0,"yaw_map_rad":0,"std_m":0}',
        '{"kind":"receipt","count":-1}',
        '{"kind":"draw_shape","shape":' + 5000 * "[",
    ],
)
def test_a_malformed_message_costs_the_line_and_nothing_else(robot: Robot, text: str) -> None:
    with Page(robot.port, tab="broken") as broken:
        broken.line.send(text)
        assert broken.receive(wire.Bye).reason
        with pytest.raises(ConnectionClosed):
            broken.receive(Never)
    with Page(robot.port) as page:
        assert page.receive(wire.Hello).role == "operator"


@pytest.mark.parametrize("number", ["NaN", "Infinity", "1e999", '"1"', "true", "null", 400 * "9"])
def test_a_drive_request_that_is_no_number_never_reaches_the_robot(
    robot: Robot, number: str
) -> None:
    with Page(robot.port, tab="numbers") as page:
        page.take_seat()
        page.send_text(f'{{"kind":"drive_by_hand","v_mps":{number},"yaw_rate_radps":0}}')
        assert page.receive(wire.Bye).reason
    assert not [order for order in robot.of_kind(wire.DriveOrder) if order.v_mps]


def test_the_seat_is_free_after_silence_and_its_owner_gets_it_back_before() -> None:
    seat = Seat()
    assert seat.take("a", "Ada", 0.0) is None
    assert seat.take("b", "Bob", SILENCE_S) == SeatHeld("Ada")
    seat.note_life("a", SILENCE_S)
    assert seat.take("b", "Bob", 2 * SILENCE_S) == SeatHeld("Ada")
    assert seat.seen_by("a", 100.0) == "you"
    assert seat.seen_by("b", 100.0) == "free"
    assert seat.take("b", "Bob", 100.0) is None
    assert seat.seen_by("a", 100.0) == "other"


def test_a_pose_by_hand_needs_the_seat_and_a_robot_at_rest(robot: Robot, page: Page) -> None:
    pose = wire.CorrectPose(x_map_m=1.0, y_map_m=2.0, yaw_map_rad=0.5)
    assert "seat" in page.ask(pose).reason
    page.take_seat()
    robot.say(msgspec.structs.replace(make_state(1), v_mps=0.4))
    page.receive(wire.State)
    assert "drives" in page.ask(pose).reason
    robot.say(msgspec.structs.replace(make_state(2, "paused"), v_mps=0.0))
    page.receive(wire.State)
    assert page.ask(pose).ok
    order = robot.wait_for_request("pose_estimate")
    assert isinstance(order.request, wire.CorrectPose)
    assert order.request.pose == (1.0, 2.0, 0.5, 0.3, 0.1)
