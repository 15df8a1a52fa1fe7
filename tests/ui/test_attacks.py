"""Whatever strangers, viewers and broken programs send: the operator's STOP is acted upon."""

from __future__ import annotations

import contextlib
import http.client
import json
import socket
from collections.abc import Iterator
from contextlib import ExitStack
from typing import Any

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus

from agribot.core.request_text import describe_request
from agribot.ui import wire
from agribot.ui.server.allowance import MAX_BURST
from agribot.ui.server.connection_slots import MAX_CONNECTIONS
from agribot.ui.server.guesses import MAX_GUESSES
from agribot.ui.server.hub import NOTES_PER_MINUTE
from agribot.ui.server.page_slots import MAX_VIEWERS
from tests.ui.client import Never, Page
from tests.ui.conftest import Robot
from tests.waiting import PATIENCE_S

BOMB = "name: &a0 x\n" + "".join(
    f"k{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]\n" for i in range(1, 12)
)


class Tablet:
    """A browser on the network that has logged in."""

    def __init__(self, robot: Robot, token: str) -> None:
        self.robot, self.origin = robot, {"Origin": f"http://127.0.0.1:{robot.port}"}
        self.cookie = ""
        status, _, headers = self.ask("POST", "/api/v1/login", {"token": token})
        assert status == 204
        self.cookie = headers["set-cookie"].split(";")[0]

    def ask(self, method: str, path: str, body: object = None) -> tuple[int, bytes, dict[str, str]]:
        line = http.client.HTTPConnection("127.0.0.1", self.robot.port, timeout=PATIENCE_S)
        data = body if isinstance(body, bytes) or body is None else json.dumps(body).encode()
        headers = {**self.origin, **({"Cookie": self.cookie} if self.cookie else {})}
        with contextlib.closing(line):
            line.request(method, path, data, headers)
            answer = line.getresponse()
            return answer.status, answer.read(), {k.lower(): v for k, v in answer.getheaders()}

    def page(self, tab: str = "one") -> Page:
        return Page(self.robot.port, tab=tab, additional_headers={"Cookie": self.cookie})


@pytest.fixture
def lan(lan_robot: Robot) -> Robot:
    lan_robot.orders.clear()
    return lan_robot


@pytest.fixture
def operator(lan: Robot) -> Tablet:
    return Tablet(lan, lan.address.operator_token)


@pytest.fixture
def viewer(lan: Robot) -> Tablet:
    return Tablet(lan, lan.address.viewer_token)


@pytest.fixture
def page(operator: Tablet) -> Iterator[Page]:
    with operator.page() as page:
        page.take_seat()
        yield page
        page.ask(wire.ClearStop())
        page.send(wire.LeaveSeat())


def assert_stops(robot: Robot, page: Page) -> None:
    """The next STOP of this page reaches the robot, and is confirmed."""
    robot.orders.clear()
    page.ask(wire.ClearStop())
    assert page.ask(wire.PressStop()).ok
    robot.wait_for_request("stop")


def begin_login(port: int, length: str, start: bytes) -> socket.socket:
    """A request to log in whose body is only begun."""
    line = socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S)
    head = f"POST /api/v1/login HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n{length}\r\n"
    line.sendall(f"{head}Origin: http://127.0.0.1:{port}\r\n\r\n".encode() + start)
    return line


@pytest.mark.parametrize(
    ("length", "start"),
    [
        ("Content-Length: 20000000", b""),
        ("Transfer-Encoding: chunked", b"1000\r\n" + b"x" * 0x1000 + b"\r\n"),
    ],
)
def test_a_large_login_is_refused_before_its_body_has_come(
    lan: Robot, page: Page, length: str, start: bytes
) -> None:
    with begin_login(lan.port, length, start) as line:
        assert line.recv(12) == b"HTTP/1.1 413"
        assert_stops(lan, page)


def test_requests_with_half_a_body_keep_neither_a_stop_nor_a_new_page_out(
    lan: Robot, operator: Tablet, page: Page
) -> None:
    with ExitStack() as stack:
        for _ in range(MAX_CONNECTIONS + 20):
            stack.enter_context(begin_login(lan.port, "Content-Length: 100", b'{"token"'))
        assert_stops(lan, page)
        assert operator.ask("GET", "/api/v1/field")[0] == 200
        with operator.page("reloaded") as again:
            assert_stops(lan, again)


def test_strangers_get_no_session_and_take_none_away(
    lan: Robot, operator: Tablet, page: Page
) -> None:
    stranger = http.client.HTTPConnection("127.0.0.1", lan.port, timeout=PATIENCE_S)
    with contextlib.closing(stranger):
        for _ in range(30):
            stranger.request("GET", "/")
            answer = stranger.getresponse()
            answer.read()
            assert answer.getheader("set-cookie") is None
    assert operator.ask("GET", "/api/v1/field")[0] == 200
    assert_stops(lan, page)


def test_wrong_tokens_lock_nobody_out_who_has_the_right_one(
    lan: Robot, operator: Tablet, page: Page
) -> None:
    guess = Tablet.__new__(Tablet)
    guess.robot, guess.origin, guess.cookie = lan, operator.origin, ""
    statuses = [
        guess.ask("POST", "/api/v1/login", {"token": f"guess {number}"})[0]
        for number in range(MAX_GUESSES + 3)
    ]
    assert statuses == [401] * MAX_GUESSES + [429] * 3
    right = lan.address.operator_token
    assert guess.ask("POST", "/api/v1/login", {"token": right})[0] == 204
    assert guess.ask("GET", f"/?token={right}")[0] == 303
    assert operator.ask("GET", "/api/v1/field")[0] == 200
    assert_stops(lan, page)


def test_a_flood_of_stops_is_merged_and_the_next_stop_counts_at_once(
    lan: Robot, viewer: Tablet, page: Page
) -> None:
    with viewer.page() as flood, pytest.raises(ConnectionClosed):
        for _ in range(10_000):
            flood.send(wire.PressStop())
        flood.receive(Never)
    first = lan.wait_for_request("stop")
    assert first.request == wire.PressStop(), "the first one was acted upon by itself"
    assert_stops(lan, page)
    sent = [o for o in lan.of_kind(wire.RequestOrder) if o.request.word == "stop"]
    assert len(sent) < 100


def test_a_flood_of_requests_for_the_seat_pushes_no_answer_out(
    lan: Robot, viewer: Tablet, page: Page
) -> None:
    page.send(wire.Ping(sent_ms=1.0))
    with viewer.page() as flood:
        for number in range(400):
            flood.send(wire.TakeSeat(id=str(number)))
        flood.ask(wire.TakeSeat())
    page.send(wire.Ping(sent_ms=2.0))
    told = [page.receive_any()]
    while not isinstance(last := told[-1], wire.Pong) or last.sent_ms != 2.0:
        told.append(page.receive_any())
    assert 1.0 in [message.sent_ms for message in told if isinstance(message, wire.Pong)]
    assert sum(isinstance(message, wire.SeatChange) for message in told) < 300
    assert_stops(lan, page)


def test_refusals_and_points_of_viewers_leave_room_for_what_operators_do(
    lan: Robot, viewer: Tablet, operator: Tablet
) -> None:
    guest = Tablet.__new__(Tablet)
    guest.robot, guest.origin, guest.cookie = lan, operator.origin, ""
    assert {guest.ask("GET", "/api/v1/field")[0] for _ in range(NOTES_PER_MINUTE + 10)} == {401}
    with viewer.page() as onlooker:
        for _ in range(NOTES_PER_MINUTE + 10):
            onlooker.send(wire.PointOut(x_map_m=7.0, y_map_m=7.0))
        onlooker.ask(wire.PointOut(x_map_m=7.0, y_map_m=7.0))
    with operator.page() as page:
        page.ask(wire.UseName(name="Bob"))
        page.take_seat()
        page.ask(wire.PointOut(x_map_m=1.0, y_map_m=2.0))
        page.send(wire.LeaveSeat())
        lan.wait_for_request("note", lambda note: note.text == "leaves the operator's seat")
    said = [
        (order.who, describe_request(order.request)) for order in lan.of_kind(wire.RequestOrder)
    ]
    assert [text for who, text in said if who == wire.Who("Bob")] == [
        "takes the operator's seat",
        "point: East 1.000 m, North 2.000 m",
        "leaves the operator's seat",
    ]
    assert sum("refused" in text for _, text in said) <= NOTES_PER_MINUTE


def test_text_with_stop_in_it_is_counted_like_any_other(lan: Robot, viewer: Tablet) -> None:
    with viewer.page() as flood, pytest.raises(ConnectionClosed):
        for _ in range(10_000):
            flood.send_text('{"kind":"use_name","name":"press_stop","stop":true}')
        flood.receive(Never)


@pytest.mark.parametrize("path", ["/ws/v1?tab=flood", "/ws/cam/main"])
@pytest.mark.parametrize(
    "frame",
    [
        bytes.fromhex("89840000000061616161"),
        bytes.fromhex("8a80 00000000"),
        bytes.fromhex("0080 00000000"),
        bytes.fromhex("8181 0000000031"),
        bytes.fromhex("8281 0000000031"),
    ],
    ids=["ping", "pong", "empty continuation", "text", "binary"],
)
def test_a_flood_of_frames_of_any_kind_costs_that_line_alone(
    lan: Robot, viewer: Tablet, page: Page, path: str, frame: bytes
) -> None:
    flood = Page(lan.port, path=path, additional_headers={"Cookie": viewer.cookie})
    start = bytes.fromhex("0181 0000000031") if frame[0] == 0 else b""
    with flood, pytest.raises(ConnectionClosed):
        with contextlib.suppress(OSError):  # cut while it sends
            flood.line.socket.sendall(start + frame * 50 * MAX_BURST)
        flood.receive(Never)
    assert_stops(lan, page)


def test_viewers_that_take_all_their_places_keep_no_operator_out(
    lan: Robot, viewer: Tablet, operator: Tablet
) -> None:
    with ExitStack() as stack:
        for number in range(MAX_VIEWERS):
            stack.enter_context(viewer.page(f"tab-{number}"))
        with pytest.raises(InvalidStatus):
            viewer.page("one-too-many").__enter__()
        with operator.page() as page:
            page.take_seat()
            assert_stops(lan, page)


def test_a_bomb_of_aliases_is_refused_and_viewers_may_not_send_one(
    lan: Robot, viewer: Tablet, operator: Tablet, page: Page
) -> None:
    path, bomb = "/api/v1/views/import", f"displays: []\n{BOMB}".encode()
    assert viewer.ask("POST", path, bomb)[0] == 403
    status, answer, _ = operator.ask("POST", path, bomb)
    assert status == 422
    assert "aliases" in json.loads(answer)["error"]
    assert operator.ask("POST", path, b"x: " + b"y" * 100_000)[0] == 413
    assert operator.ask("POST", path, b"displays: []")[0] == 200
    assert_stops(lan, page)


@pytest.mark.parametrize("path", ["/api/v1/recordings/mark", "/api/v1/replay", "/api/v1/login"])
@pytest.mark.parametrize("opening", [b"[", b'{"a":'])
def test_json_that_is_nested_without_end_is_a_bad_request(
    operator: Tablet, path: str, opening: bytes
) -> None:
    assert operator.ask("POST", path, opening * 300)[0] == 400
    assert operator.ask("POST", path, opening * 1900)[0] in {400, 413}


def test_nested_json_on_the_socket_costs_that_line_alone(
    lan: Robot, viewer: Tablet, page: Page
) -> None:
    with viewer.page() as broken:
        broken.line.send("[" * 50_000)
        assert "object" in broken.receive(wire.Bye).reason
    assert_stops(lan, page)


def test_a_viewer_may_send_small_requests_only(viewer: Tablet) -> None:
    body: dict[str, Any] = {"x": "y" * 20_000}
    for path in ("/api/v1/fields/import?filename=a.kml", "/api/v1/plan"):
        assert viewer.ask("POST", path, body)[0] == 413
