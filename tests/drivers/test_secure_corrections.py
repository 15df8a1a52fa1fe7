"""Corrections over TLS: they and the login are encrypted, and a caster proves its identity."""

from __future__ import annotations

import contextlib
import socket
import ssl
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import pytest

from agribot.core.errors import ConfigError
from agribot.core.fact_text import render
from agribot.core.facts import CorrectionsCome
from agribot.core.messages import DeviceNote
from agribot.drivers.gnss import ntrip
from agribot.drivers.gnss.corrections import CorrectionLink, CorrectionTiming, make_tls
from agribot.drivers.line import caster_login
from tests import machine
from tests.drivers.caster import STATION, YES, FakeCaster, make_observation
from tests.drivers.lines import Line, Opened, speak_ubx
from tests.waiting import PATIENCE_S, wait_for

pytestmark = machine.needs("openssl")
NEW_KEY = ("-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes")
LOGIN = caster_login.CasterLogin("farmer", "s3cret")
TIMING = CorrectionTiming(gga_period_s=0.02, stall_s=600, first_wait_s=0.01, longest_wait_s=0.05)


def openssl(*words: str | Path) -> None:
    command = ["openssl", *map(str, words)]
    subprocess.run(command, check=True, capture_output=True, timeout=PATIENCE_S)


class Authority(NamedTuple):
    """Who signs certificates, for a service of its own or for all the world."""

    folder: Path

    @property
    def file(self) -> Path:
        return self.folder / "authority.crt"

    def found(self) -> Authority:
        files = ("-keyout", self.folder / "authority.key", "-out", self.file)
        openssl("req", "-x509", *NEW_KEY, "-days", "2", "-subj", "/CN=authority", *files)
        return self

    def sign(self, names: str, days: int = 2) -> ssl.SSLContext:
        """Make the context of a server with these names."""
        key, request, signed, extension = (
            self.folder / f"caster.{kind}" for kind in ("key", "csr", "crt", "ext")
        )
        extension.write_text(f"subjectAltName={names}\n")
        openssl("req", *NEW_KEY, "-subj", "/CN=caster", "-keyout", key, "-out", request)
        by = ("-CA", self.file, "-CAkey", self.folder / "authority.key", "-CAcreateserial")
        more = ("-days", str(days), "-extfile", extension)
        openssl("x509", "-req", "-in", request, *by, *more, "-out", signed)
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.load_cert_chain(signed, key)
        return context


@pytest.fixture(scope="module")
def authority(tmp_path_factory: pytest.TempPathFactory) -> Authority:
    return Authority(tmp_path_factory.mktemp("authority")).found()


@pytest.fixture(scope="module")
def server(authority: Authority) -> ssl.SSLContext:
    return authority.sign("DNS:localhost,IP:127.0.0.1")


@contextmanager
def casting(tls: ssl.SSLContext | None) -> Iterator[FakeCaster]:
    def serve(peer: socket.socket, _head: bytes) -> None:
        peer.sendall(YES + b"\r\n" + STATION + make_observation())
        caster.listen(peer)

    caster = FakeCaster(serve, tls=tls)
    try:
        yield caster
    finally:
        caster.close()


class Rover:
    """A receiver that takes corrections, and the reports about them."""

    def __init__(self) -> None:
        self.taken = bytearray()
        self.told: list[str] = []

    @contextmanager
    def ask(self, caster: ntrip.Caster, trust: Path | None = None) -> Iterator[None]:
        tls = make_tls(str(trust)) if trust else None
        link = CorrectionLink(
            caster, LOGIN, self._write, lambda: None, lambda fact: self.told.append(render(fact)),
            TIMING, tls=tls,
        )  # fmt: skip
        try:
            yield
        finally:
            link.close()

    def wait_told(self, text: str) -> None:
        wait_for(lambda: any(text in each for each in self.told), text)

    def _write(self, data: bytes) -> bool:
        self.taken += data
        return True


def secure(port: int, host: str = "127.0.0.1") -> ntrip.Caster:
    return ntrip.read_caster(f"ntrips://{host}:{port}/FARM")


@contextmanager
def tap(port: int) -> Iterator[tuple[int, bytearray]]:
    """Put a wire tap before a port; gives its own port and what it heard in both directions."""
    heard, ended = bytearray(), threading.Event()

    def pump(near: socket.socket, far: socket.socket) -> None:
        while not ended.is_set():
            for one, other in ((near, far), (far, near)):
                with contextlib.suppress(TimeoutError):
                    data = one.recv(4096)
                    heard.extend(data)
                    other.sendall(data)

    def serve() -> None:
        near, _ = listener.accept()
        with near, socket.create_connection(("127.0.0.1", port)) as far:
            near.settimeout(0.01)
            far.settimeout(0.01)
            with contextlib.suppress(OSError):
                pump(near, far)

    with socket.create_server(("127.0.0.1", 0)) as listener:
        thread = threading.Thread(target=serve)
        thread.start()
        try:
            yield int(listener.getsockname()[1]), heard
        finally:
            ended.set()
            thread.join()


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost"])
def test_a_caster_whose_certificate_is_trusted_feeds_the_receiver(
    host: str, authority: Authority, server: ssl.SSLContext
) -> None:
    rover = Rover()
    with casting(server) as caster, rover.ask(secure(caster.port, host), authority.file):
        wait_for(lambda: STATION + make_observation() in rover.taken, "both messages")
    come = CorrectionsCome(f"{host}:{caster.port}/FARM", is_again=False)
    assert rover.told == [render(come)]
    assert b"Authorization: Basic" in caster.requests[0]


def test_who_taps_the_wire_reads_neither_login_nor_mountpoint(
    authority: Authority, server: ssl.SSLContext
) -> None:
    rover = Rover()
    with (
        casting(server) as caster,
        tap(caster.port) as (port, heard),
        rover.ask(secure(port), authority.file),
    ):
        wait_for(lambda: STATION in rover.taken, "a message")
    assert len(heard) > 500
    assert not any(word in heard for word in (b"Basic", b"FARM", b"NTRIP", STATION))


def test_a_caster_that_nobody_vouches_for_is_told_and_hears_nothing(
    server: ssl.SSLContext,
) -> None:
    rover = Rover()
    with casting(server) as caster, rover.ask(secure(caster.port)):
        rover.wait_told("cannot prove who it is: unable to get local issuer certificate")
    assert "ntrip_ca=FILE" in rover.told[0] and len(rover.told) == 1
    assert not caster.requests and not rover.taken


@pytest.mark.parametrize(
    ("names", "days", "why"),
    [
        ("DNS:caster.example", 2, "IP address mismatch"),
        ("IP:127.0.0.1", -1, "certificate has expired"),
    ],
)
def test_a_certificate_of_another_host_and_one_that_is_over_are_told(
    names: str, days: int, why: str, authority: Authority
) -> None:
    rover, stranger = Rover(), authority.sign(names, days)
    with casting(stranger) as caster, rover.ask(secure(caster.port), authority.file):
        rover.wait_told(f"cannot prove who it is: {why}")
    assert not caster.requests


def test_who_asks_a_caster_with_tls_without_it_is_told_what_to_write(
    server: ssl.SSLContext,
) -> None:
    rover = Rover()
    with casting(server) as caster:
        plain = ntrip.read_caster(f"ntrip://127.0.0.1:{caster.port}/FARM")
        with rover.ask(plain):
            rover.wait_told("closed the line without an answer; if it speaks TLS, write ntrips://")
    assert not caster.requests


def test_a_server_of_something_else_is_told_as_one_without_tls(authority: Authority) -> None:
    rover, listener = Rover(), socket.create_server(("127.0.0.1", 0))
    with listener, rover.ask(secure(listener.getsockname()[1]), authority.file):
        peer, _ = listener.accept()
        peer.sendall(b"HTTP/1.1 400 Bad Request\r\n\r\n")
        rover.wait_told("no TLS with what answers there")
        peer.close()


def test_a_receiver_is_fed_over_tls_by_its_uri(
    authority: Authority, server: ssl.SSLContext, line: Line, opened: Opened,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.setenv(caster_login.LOGIN_VARIABLE, "farmer:s3cret")
    with casting(server) as caster:
        uri = f"serial:{line.path}?ntrip=ntrips://localhost:{caster.port}/FARM"
        source = opened.open("gnss", f"{uri}&ntrip_ca={authority.file}")
        speak_ubx(line.say)
        opened.wait_for(source)
        note = opened.wait_for(source, field="notes")[0]
        wait_for(lambda: STATION in line.hear(), "a message at the receiver")
    assert isinstance(note, DeviceNote)
    assert note.fact == CorrectionsCome(f"localhost:{caster.port}/FARM", is_again=False)


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ("ntrip=ntrips://localhost/FARM&ntrip_ca=/nowhere", "ntrip_ca=/nowhere: No such file"),
        ("ntrip=ntrips://localhost/FARM&ntrip_ca={key}", "it holds no certificate"),
        ("ntrip=ntrip://localhost/FARM&ntrip_ca={ca}", "write ntrip=ntrips://"),
        ("ntrip_ca={ca}", "write ntrip=ntrips://"),
    ],
)
def test_a_file_that_vouches_for_nobody_is_refused_before_the_run(
    options: str, why: str, authority: Authority, line: Line, opened: Opened
) -> None:
    told = options.format(ca=authority.file, key=authority.folder / "authority.key")
    with pytest.raises(ConfigError, match=why):
        opened.open("gnss", f"serial:{line.path}?{told}")


def test_the_port_is_that_of_https_where_none_is_told() -> None:
    assert ntrip.read_caster("ntrips://caster.example/FARM").port == ntrip.TLS_PORT == 443
    assert ntrip.read_caster("ntrip://caster.example/FARM").port == 2101
