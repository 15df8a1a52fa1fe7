from __future__ import annotations

import contextlib
import http.client
import json
import socket
import time
from pathlib import Path

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus

from agribot.ui import wire
from agribot.ui.server.access import Access, Caller, Refusal, read_boot_id
from agribot.ui.server.answers import inside
from agribot.ui.server.signed_session import RENEW_AFTER_S, SESSION_LIFE_S, Session, Signer
from tests.ui.client import Never, Page
from tests.ui.conftest import Robot
from tests.waiting import PATIENCE_S, wait_for


def ask(
    robot: Robot, method: str, path: str, headers: dict[str, str], body: bytes | None = None
) -> tuple[int, bytes, dict[str, str]]:
    line = http.client.HTTPConnection("127.0.0.1", robot.port, timeout=PATIENCE_S)
    try:
        line.putrequest(method, path, skip_host="Host" in headers)
        for name, value in headers.items():
            line.putheader(name, value)
        line.putheader("Content-Length", str(len(body or b"")))
        line.endheaders(body)
        answer = line.getresponse()
        return answer.status, answer.read(), {k.lower(): v for k, v in answer.getheaders()}
    finally:
        line.close()


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "http://127.0.0.1:1", "http://localhost.evil.example"]
)
def test_a_foreign_origin_gets_no_socket(robot: Robot, origin: str) -> None:
    for path in ("/ws/v1", "/ws/cam/main"):
        with pytest.raises(InvalidStatus) as refusal, Page(robot.port, origin=origin, path=path):
            pass
        assert refusal.value.response.status_code == 403
    robot.wait_for_request("note", lambda order: "refused" in order.text)


def test_a_rebound_name_is_refused_even_with_its_own_origin(robot: Robot) -> None:
    rebound = f"evil.example:{robot.port}"
    headers = {"Host": rebound, "Origin": f"http://{rebound}"}
    for path in ("/", "/api/v1/field"):
        status, body, _ = ask(robot, "GET", path, headers)
        assert status == 403
        assert b"evil.example" in body


def test_a_program_without_origin_needs_the_bearer_token(robot: Robot) -> None:
    with pytest.raises(InvalidStatus), Page(robot.port, origin=None):
        pass
    wrong = {"Authorization": "Bearer guess"}
    with (
        pytest.raises(InvalidStatus),
        Page(robot.port, origin=None, additional_headers=wrong),
    ):
        pass
    token = {"Authorization": f"Bearer {robot.address.operator_token}"}
    with Page(robot.port, origin=None, additional_headers=token) as page:
        assert page.receive(wire.Hello).role == "operator"


def test_a_foreign_page_cannot_post(robot: Robot) -> None:
    body = b'{"text": "x"}'
    path = "/api/v1/recordings/mark"
    foreign = {"Origin": "http://evil.example"}
    assert ask(robot, "POST", path, foreign, body)[0] == 403
    assert ask(robot, "POST", path, {}, body)[0] == 401
    own = {"Origin": f"http://127.0.0.1:{robot.port}"}
    assert ask(robot, "POST", path, own, body)[0] == 204


def test_on_the_network_nothing_is_told_without_a_token(lan_robot: Robot) -> None:
    for path in ("/api/v1/field", "/api/v1/health", "/tiles/x/1/0/0", "/robot/robot.urdf"):
        assert ask(lan_robot, "GET", path, {})[0] == 401
    status, body, _ = ask(lan_robot, "GET", "/api/v1/session", {})
    assert status == 200
    assert json.loads(body) == {"version": json.loads(body)["version"], "needs_login": True}
    with pytest.raises(InvalidStatus), Page(lan_robot.port):
        pass


def test_the_token_becomes_a_cookie_that_scripts_cannot_read(lan_robot: Robot) -> None:
    token = lan_robot.address.operator_token
    status, _, headers = ask(lan_robot, "GET", f"/?token={token}", {})
    assert (status, headers["location"]) == (303, "/")
    cookie = headers["set-cookie"]
    assert "HttpOnly" in cookie
    assert "samesite=strict" in cookie.lower()
    assert token not in cookie
    with Page(lan_robot.port, additional_headers={"Cookie": cookie.split(";")[0]}) as page:
        assert page.receive(wire.Hello).role == "operator"


def test_a_viewer_looks_on_and_stops_but_never_drives(lan_robot: Robot) -> None:
    body = json.dumps({"token": lan_robot.address.viewer_token}).encode()
    origin = {"Origin": f"http://127.0.0.1:{lan_robot.port}"}
    _, _, headers = ask(lan_robot, "POST", "/api/v1/login", origin, body)
    cookie = headers["set-cookie"].split(";")[0]
    with Page(lan_robot.port, additional_headers={"Cookie": cookie}) as page:
        assert page.receive(wire.Hello).role == "viewer"
        answer = page.ask(wire.TakeSeat(force=True))
        assert not answer.ok
        assert "viewer" in answer.reason
        orders = (
            wire.GoTo(x_map_m=1.0, y_map_m=1.0),
            wire.ControlRecording(action="stop"),
            wire.MarkMoment(text="x"),
            wire.CorrectPose(x_map_m=0.0, y_map_m=0.0, yaw_map_rad=0.0),
        )
        for order in orders:
            assert "viewer" in page.ask(order).reason
        page.send(wire.PressStop())
        lan_robot.wait_for_request("stop")
    put = ask(lan_robot, "PUT", "/api/v1/views/x", {**origin, "Cookie": cookie}, b"{}")
    assert put[0] == 403
    for path in ("plan/apply", "recordings/start", "recordings/stop", "recordings/mark"):
        post = ask(lan_robot, "POST", f"/api/v1/{path}", {**origin, "Cookie": cookie}, b"{}")
        assert post[0] == 403, path
    words = [order.request.word for order in lan_robot.of_kind(wire.RequestOrder)]
    assert [word for word in words if word != "note"] == ["stop"]


def test_a_session_that_is_not_used_for_long_is_a_stranger(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now_s = 1000.0
    monkeypatch.setattr(time, "monotonic", lambda: now_s)
    access = Access(("field.local",), 8080, "operator", "viewer", "key", is_local=False)
    headers = {"host": "field.local:8080", "origin": "http://field.local:8080"}

    def visit(cookie: str) -> Caller | Refusal:
        return access.check(
            "websocket", "GET", "/ws/v1", {**headers, "cookie": f"{access.cookie}={cookie}"}
        )

    cookie = access.login("operator", "10.0.0.1")
    assert isinstance(cookie, str)
    first = visit(cookie)
    assert isinstance(first, Caller) and not first.cookie, "nothing to renew yet"
    now_s += SESSION_LIFE_S - 1.0
    renewed = visit(cookie)
    assert isinstance(renewed, Caller) and renewed.session == first.session and renewed.cookie
    now_s += 10.0
    assert isinstance(visit(cookie), Refusal), "the old cookie is over"
    again = visit(renewed.cookie)
    assert isinstance(again, Caller) and again.session == first.session


def test_a_session_cannot_be_made_or_changed_without_the_key() -> None:
    headers = {"host": "field.local:8080"}
    robots = [
        Access(("field.local",), 8080, "operator", "viewer", key, is_local=False)
        for key in ("key", "other key")
    ]
    cookie = robots[0].login("viewer", "10.0.0.1")
    assert isinstance(cookie, str)
    assert isinstance(_field(robots[0], headers, cookie), Caller)
    forged = [cookie.replace("viewer", "operator"), cookie[:-1], "", "a.b.c.d", "operator", "...."]
    for text in forged:
        assert isinstance(_field(robots[0], headers, text), Refusal), text
    assert isinstance(_field(robots[1], headers, cookie), Refusal)


def _field(access: Access, headers: dict[str, str], cookie: str) -> Caller | Refusal:
    shown = {**headers, "cookie": f"{access.cookie}={cookie}"}
    return access.check("http", "GET", "/api/v1/field", shown)


def test_a_session_in_use_is_renewed_and_never_in_place_of_a_new_one(lan_robot: Robot) -> None:
    address, name = lan_robot.address, f"agribot_{lan_robot.port}"
    signer = Signer(f"{address.session_key}{read_boot_id()}")
    old = signer.cookie(Session("tablet", "viewer", time.monotonic() - 2.0 * RENEW_AFTER_S))
    headers = {"Cookie": f"{name}={old}", "Origin": f"http://127.0.0.1:{lan_robot.port}"}

    def cookies(method: str, path: str, body: bytes = b"") -> list[Session | None]:
        line = http.client.HTTPConnection("127.0.0.1", lan_robot.port, timeout=PATIENCE_S)
        with contextlib.closing(line):
            line.request(method, path, body or None, headers)
            found = line.getresponse().headers.get_all("set-cookie", [])
        values = [text.split(";")[0].removeprefix(f"{name}=") for text in found]
        return [signer.session(value, time.monotonic()) for value in values]

    [renewed] = cookies("GET", "/api/v1/field")
    assert renewed is not None
    assert (renewed.id, renewed.role) == ("tablet", "viewer")
    assert renewed.at_s > time.monotonic() - RENEW_AFTER_S
    assert cookies("GET", "/icon.svg") == [], "it may lie in a cache of many"
    token = json.dumps({"token": address.operator_token}).encode()
    for method, path, body in (
        ("POST", "/api/v1/login", token),
        ("GET", f"/?token={address.operator_token}", b""),
    ):
        [new] = cookies(method, path, body)
        assert new is not None
        assert new.role == "operator"


@pytest.mark.parametrize(
    "path",
    [
        "/../../pyproject.toml",
        "/assets/..%2f..%2fserver.py",
        "/%2e%2e/server.py",
        "/robot/..%2f..%2fconfig.py",
        "/robot//etc/passwd",
        "/tiles/..%2f..%2fsecret/0/0/0",
        "/api/v1/recordings/..%2f..%2fhome/x",
        "/api/v1/recordings/now/..%2f..%2fsecret.txt",
        "/api/v1/fields/..%2f..%2fsecret",
        "/api/v1/views/%00",
    ],
)
def test_no_path_leads_out_of_the_folders(robot: Robot, path: str) -> None:
    run = robot.home / "runs" / "now"
    run.mkdir(parents=True, exist_ok=True)
    (run / "run.mcap").touch()
    (robot.home / "secret.txt").write_text("hidden words", encoding="utf-8")
    status, body, _ = ask(robot, "GET", path, {})
    assert status in {400, 404}
    assert b"hidden words" not in body


def test_links_out_of_a_folder_are_not_followed(tmp_path: Path) -> None:
    (tmp_path / "runs").mkdir()
    (tmp_path / "outside").write_text("x", encoding="utf-8")
    (tmp_path / "runs" / "link").symlink_to(tmp_path / "outside")
    assert inside(tmp_path / "runs", "link") is None
    assert inside(tmp_path / "runs", "inner") == (tmp_path / "runs" / "inner").resolve()


def test_an_oversized_frame_costs_the_line_and_nothing_else(robot: Robot, page: Page) -> None:
    with Page(robot.port, tab="large") as large, pytest.raises(ConnectionClosed):
        large.send(wire.MarkMoment(text="x" * 200_000))
        large.receive(Never)
    page.send(wire.Ping(sent_ms=1))
    assert page.receive(wire.Pong).sent_ms == 1


def test_a_binary_frame_costs_the_line(robot: Robot) -> None:
    with Page(robot.port, tab="binary") as page, pytest.raises(ConnectionClosed):
        page.line.send(b"\x00\x01")
        page.receive(Never)


def test_a_thousand_lines_do_not_keep_the_operator_out(robot: Robot, page: Page) -> None:
    lines: list[socket.socket] = []
    refused = 0
    try:
        for _ in range(1000):
            try:
                lines.append(socket.create_connection(("127.0.0.1", robot.port), timeout=2.0))
            except OSError:
                refused += 1
        page.take_seat()
        page.send(wire.DriveByHand(v_mps=0.2, yaw_rate_radps=0.0))
        robot.wait_for(wire.DriveOrder, lambda order: order.v_mps == 0.2)
        for line in lines:
            line.settimeout(0.0)
        wait_for(
            lambda: refused + sum(is_cut(line) for line in lines) >= 700, "the end of most lines"
        )
        with Page(robot.port, tab="again") as again:
            again.send(wire.PressStop())
            robot.wait_for_request("stop")
    finally:
        for line in lines:
            line.close()


def is_cut(line: socket.socket) -> bool:
    try:
        return line.recv(1) == b""
    except BlockingIOError:
        return False
    except OSError:
        return True


def test_answers_forbid_framing_and_foreign_content(robot: Robot) -> None:
    _, _, headers = ask(robot, "GET", "/", {})
    assert headers["x-frame-options"] == "DENY"
    assert "default-src 'self'" in headers["content-security-policy"]
    assert "access-control-allow-origin" not in headers
