"""Where the page is found: host, port, names, tokens, and the note for programs beside it."""

from __future__ import annotations

import contextlib
import os
import secrets
import socket
import ssl
from pathlib import Path

import msgspec

from agribot.core.errors import ConfigError
from agribot.core.home import find_home

DEFAULT_PORT = 8080
PORTS_TRIED = 20
SEND_BUFFER_BYTES = 64 * 1024  # buffer of one page; its content is old by the time it is read
BACKLOG = 64
LOCAL_HOSTS = ("127.0.0.1", "localhost", "::1")
SELF_SIGNED = (
    "make both with openssl req -x509 -newkey rsa:2048 -nodes -days 800 -keyout robot.key "
    "-out robot.crt -subj /CN=robot -addext subjectAltName=DNS:robot.local,IP:192.168.1.7"
)


class Address(msgspec.Struct, kw_only=True):
    """`port` None takes the first free one from 8080 on; 0 any."""

    host: str = "127.0.0.1"
    port: int | None = None
    allowed_hosts: tuple[str, ...] = ()
    operator_token: str = msgspec.field(default_factory=lambda: secrets.token_urlsafe(18))
    viewer_token: str = msgspec.field(default_factory=lambda: secrets.token_urlsafe(18))
    session_key: str = msgspec.field(default_factory=lambda: secrets.token_urlsafe(32))
    tls_cert: str = ""  # PEM files; with them everything is encrypted
    tls_key: str = ""

    @property
    def is_encrypted(self) -> bool:
        return bool(self.tls_cert)

    def check_tls(self) -> None:
        """Check certificate and key.

        Raises: ConfigError: one file of the two, or files that do not fit each other.
        """
        if not (self.tls_cert or self.tls_key):
            return
        if not (self.tls_cert and self.tls_key):
            raise ConfigError(f"--tls-cert and --tls-key belong together; {SELF_SIGNED}")
        try:
            ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(self.tls_cert, self.tls_key)
        except (OSError, ssl.SSLError) as error:
            raise ConfigError(
                f"{self.tls_cert} and {self.tls_key} are no certificate and its key: {error}; "
                f"{SELF_SIGNED}"
            ) from error

    @property
    def is_local(self) -> bool:
        return self.host in LOCAL_HOSTS

    @property
    def home(self) -> Path:
        """Where fields, views and maps of this machine are kept."""
        return find_home()

    def names(self) -> tuple[str, ...]:
        """Every name by which a browser may call this server, besides the local ones."""
        if self.is_local:
            return self.allowed_hosts
        hostname = socket.gethostname()
        own = (lan_address(),) if self.host in {"0.0.0.0", "::"} else (self.host,)
        return (*own, hostname, f"{hostname}.local", *self.allowed_hosts)

    def url(self, port: int) -> str:
        """Return the address to open: on the network it carries the token."""
        if self.is_local:
            return f"{self._scheme}://127.0.0.1:{port}/"
        return self.lan_url(port)

    def lan_url(self, port: int) -> str:
        """For other devices; empty where the page is served to this machine alone."""
        if self.is_local:
            return ""
        name = lan_address() if self.host in {"0.0.0.0", "::"} else self.host
        return f"{self._scheme}://{name}:{port}/?token={self.operator_token}"

    @property
    def _scheme(self) -> str:
        return "https" if self.is_encrypted else "http"

    def viewer_url(self, port: int) -> str:
        return self.lan_url(port).replace(self.operator_token, self.viewer_token)

    def write_door(self, port: int) -> None:
        """Leave address and token for programs of the same user, such as `agribot teleop`."""
        path = door_file(port)
        path.parent.mkdir(parents=True, exist_ok=True)
        host = "127.0.0.1" if self.is_local or self.host == "0.0.0.0" else self.host
        scheme = "wss" if self.is_encrypted else "ws"
        cert = str(Path(self.tls_cert).resolve()) if self.is_encrypted else ""
        door = RobotDoor(
            url=f"{scheme}://{host}:{port}/ws/v1", token=self.operator_token, cert=cert
        )
        path.unlink(missing_ok=True)
        handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(handle, "wb") as file:
            file.write(msgspec.json.encode(door))

    def remove_door(self, port: int) -> None:
        with contextlib.suppress(OSError):
            door_file(port).unlink()


class RobotDoor(msgspec.Struct, frozen=True, kw_only=True):
    """`cert` is the certificate to be trusted, where it is not one that all machines trust."""

    url: str
    token: str
    cert: str = ""


def door_file(port: int) -> Path:
    return find_home() / "doors" / f"{port}.json"


def read_door(port: int) -> RobotDoor:
    """Read how a running robot of this machine is reached.

    Raises: ConfigError: no robot with a page runs here.
    """
    try:
        return msgspec.json.decode(door_file(port).read_bytes(), type=RobotDoor)
    except (OSError, msgspec.DecodeError) as error:
        raise ConfigError(
            f"no robot with a page runs on port {port} of this machine; start one with "
            "'agribot run --ui', or name it with --url and --token"
        ) from error


def bound(address: Address) -> socket.socket:
    """Open a listening socket, so that a taken port is an error before the robot moves.

    Raises: ConfigError: the host is no address of this machine, or the port is taken.
    """
    first = DEFAULT_PORT if address.port is None else address.port
    last = first + PORTS_TRIED if address.port is None else first
    failure: OSError | None = None
    for port in range(first, last + 1):
        try:
            return _listening(address.host, port)
        except OSError as error:
            failure = error
    raise ConfigError(
        f"cannot serve the page at {address.host}:{first}: "
        f"{failure.strerror if failure else 'no port'}; choose another --port or --host"
    )


def _listening(host: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listener = socket.socket(family, socket.SOCK_STREAM)
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
        listener.bind((host, port))
        listener.listen(BACKLOG)
    except (OSError, OverflowError) as error:
        listener.close()
        if isinstance(error, OverflowError):
            raise OSError(22, f"port {port} is not between 0 and 65535") from error
        raise
    return listener


def lan_address() -> str:
    """Find the address of this machine on its network; nothing is sent for it."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))
            return str(probe.getsockname()[0])
        except OSError:
            return "127.0.0.1"
