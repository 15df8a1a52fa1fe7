"""Everything encrypted, with a certificate of the robot's own."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import ssl
import subprocess
import threading
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any
from urllib.error import HTTPError, URLError
from urllib.request import urlopen

import pytest

pytest.importorskip("uvicorn")
import uvicorn
from starlette.applications import Starlette

from agribot.cli.main import main
from agribot.core.errors import ConfigError
from agribot.ui import wire
from agribot.ui.address import Address, read_door
from agribot.ui.hand import remote
from agribot.ui.hand.blocking_socket import BlockingSocket
from agribot.ui.hand.remote import Remote
from agribot.ui.server import guarded_connections
from agribot.ui.server.connection_slots import ConnectionSlots
from tests import machine
from tests.ui.conftest import Robot
from tests.waiting import PATIENCE_S

pytestmark = machine.needs("openssl")


def certificate(folder: Path, name: str) -> tuple[str, str]:
    cert, key = folder / f"{name}.crt", folder / f"{name}.key"
    words = [
        "req",
        "-x509",
        "-newkey",
        "ec",
        "-pkeyopt",
        "ec_paramgen_curve:prime256v1",
        "-nodes",
        "-days",
        "2",
        "-subj",
        "/CN=robot",
    ]
    names = ["-addext", "subjectAltName=DNS:localhost,IP:127.0.0.1"]
    files = ["-keyout", str(key), "-out", str(cert)]
    subprocess.run(["openssl", *words, *names, *files], check=True, capture_output=True, timeout=60)
    return str(cert), str(key)


@pytest.fixture(scope="module")
def encrypted(tmp_path_factory: pytest.TempPathFactory, _own_home: None) -> Iterator[Robot]:
    home = tmp_path_factory.mktemp("tls")
    cert, key = certificate(home, "robot")
    robot = Robot(home, Address(port=0, tls_cert=cert, tls_key=key))
    robot.start()
    yield robot
    robot.server.close()


@pytest.fixture
def trust(encrypted: Robot) -> ssl.SSLContext:
    return ssl.create_default_context(cafile=encrypted.address.tls_cert)


def test_who_does_not_shake_hands_is_cut(encrypted: Robot) -> None:
    with (
        socket.create_connection(("127.0.0.1", encrypted.port), timeout=50.0) as line,
        contextlib.suppress(ConnectionResetError),
    ):
        assert line.recv(1) == b"", "asyncio alone would wait for 60 s"


@pytest.fixture
def patient_port(encrypted: Robot, monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """Of a server that waits long for a handshake and has few places."""
    monkeypatch.setattr(guarded_connections, "HANDSHAKE_S", PATIENCE_S)

    @contextlib.asynccontextmanager
    async def lifespan(_: Any) -> Any:
        yield {"slots": ConnectionSlots(limit=3)}

    address = encrypted.address
    config = uvicorn.Config(
        Starlette(lifespan=lifespan), http=guarded_connections.GuardedHttp, log_level="critical",
        ssl_certfile=address.tls_cert, ssl_keyfile=address.tls_key, timeout_graceful_shutdown=1,
    )  # fmt: skip
    server, listener = uvicorn.Server(config), socket.create_server(("127.0.0.1", 0))

    async def serve() -> None:
        loop = asyncio.get_running_loop()
        guarded = partial(guarded_connections.serve_guarded, loop.create_server)
        loop.create_server = guarded  # type: ignore[method-assign]
        await server.serve(sockets=[listener])

    thread = threading.Thread(target=lambda: asyncio.run(serve()), daemon=True)
    thread.start()
    yield listener.getsockname()[1]
    server.should_exit = True
    thread.join()


def test_a_line_before_its_handshake_gives_way_to_new_ones(
    patient_port: int, trust: ssl.SSLContext
) -> None:
    with contextlib.ExitStack() as stack:
        address = ("127.0.0.1", patient_port)
        silent = [
            stack.enter_context(socket.create_connection(address, timeout=PATIENCE_S))
            for _ in range(4)
        ]
        with contextlib.suppress(ConnectionResetError):
            assert silent[0].recv(1) == b"", "while the handshake still had time"
        with pytest.raises(HTTPError, match="404"):
            urlopen(f"https://127.0.0.1:{patient_port}/", context=trust)


def test_the_page_comes_over_https_alone_and_its_cookie_stays_there(
    encrypted: Robot, trust: ssl.SSLContext
) -> None:
    assert encrypted.server.url.startswith("https://")
    with urlopen(encrypted.server.url, context=trust) as answer:
        assert answer.status == 200
        assert "Secure" in answer.headers["set-cookie"]
    with pytest.raises(URLError, match="CERTIFICATE_VERIFY_FAILED"):
        urlopen(encrypted.server.url, context=ssl.create_default_context())
    with pytest.raises(OSError):
        urlopen(encrypted.server.url.replace("https:", "http:"), timeout=PATIENCE_S)


def test_states_and_orders_are_encrypted_too(
    encrypted: Robot, trust: ssl.SSLContext, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(remote, "ANSWER_S", PATIENCE_S)
    port = encrypted.port
    origin = {"Origin": f"https://127.0.0.1:{port}"}
    url = f"wss://127.0.0.1:{port}/ws/v1"
    with BlockingSocket(url, origin, trust, PATIENCE_S) as line:
        assert '"hello"' in str(line.receive(PATIENCE_S))
    door = read_door(port)
    assert door.url.startswith("wss://")
    with Remote(door, "a program") as robot:
        robot.take_seat(force=True)
        robot.drive(0.1, 0.0)
        encrypted.wait_for(wire.DriveOrder, lambda order: order.v_mps == 0.1)


def test_one_thread_alone_reads_and_writes_an_encrypted_line(
    encrypted: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    threads: dict[str, set[int]] = {"reads": set(), "writes": set()}

    def watched(kind: type, name: str, what: str) -> None:
        plain = getattr(kind, name)

        def call(self: Any, *values: Any) -> Any:
            threads[what].add(threading.get_ident())
            return plain(self, *values)

        monkeypatch.setattr(kind, name, call)

    for kind in (ssl.SSLObject, ssl.SSLSocket):
        watched(kind, "read", "reads")
        watched(kind, "write", "writes")
    watched(ssl.SSLSocket, "send", "writes")
    monkeypatch.setattr(remote, "ANSWER_S", PATIENCE_S)
    with Remote(read_door(encrypted.port), "a program") as robot:
        robot.take_seat(force=True)
        robot.drive(0.2, 0.0)
        encrypted.wait_for(wire.DriveOrder, lambda order: order.v_mps == 0.2)
    assert len(threads["reads"]) == 1
    assert threads["writes"] == threads["reads"], "OpenSSL allows no second thread"


def test_files_that_do_not_fit_are_refused_before_anything_moves(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cert, _ = certificate(tmp_path, "one")
    _, other_key = certificate(tmp_path, "other")
    for words in (["--tls-cert", cert], ["--tls-cert", cert, "--tls-key", other_key],
                  ["--tls-cert", str(tmp_path / "none"), "--tls-key", other_key]):  # fmt: skip
        assert main(["run", "farm", "--ui", "--out", str(tmp_path / "run"), *words]) == 2
        assert "openssl req -x509" in capsys.readouterr().err
    with pytest.raises(ConfigError, match="belong together"):
        Address(tls_key=other_key).check_tls()
