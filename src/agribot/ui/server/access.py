"""Who may talk to the robot: names of this machine, origins, tokens, sessions, roles.

A browser shows its origin and carries a cookie; a program shows no origin and carries a bearer
token. On the machine itself a page needs no token, on the network every page does.

A session is a signed cookie: the server stores none, so that no client can push another one out,
and a server that is started again knows its browsers.
"""

from __future__ import annotations

import hashlib
import secrets
import time
from collections.abc import Mapping
from http.cookies import CookieError, SimpleCookie
from pathlib import Path
from typing import Literal

import msgspec

from agribot.core.fact_text import render
from agribot.core.facts import Fact, TokenNeeded, TokensWrong, TokenWrong
from agribot.core.messages import AskerKind, Who
from agribot.ui.server.guesses import Guesses
from agribot.ui.server.signed_session import RENEW_AFTER_S, Session, Signer

Role = Literal["operator", "viewer"]

BOOT_ID = Path("/proc/sys/kernel/random/boot_id")  # file of Linux, random(4)
LOCAL_NAMES = ("localhost", "127.0.0.1", "[::1]")
OPEN_PATHS = ("/", "/index.html", "/favicon.ico", "/icon.svg", "/licences.txt", "/api/v1/login")
OPEN_FOLDERS = ("/assets/",)


class Caller(msgspec.Struct, frozen=True, kw_only=True):
    """`session` is empty for a browser without one; `role` is None for an unknown visitor.

    `cookie` is the renewed one where the browser's has grown old.
    """

    session: str
    role: Role | None
    cookie: str = ""


def make_who(name: str, role: str | None) -> Who:
    """Make who asks of a name and a role; None of an unknown visitor."""
    return Who(name, AskerKind.UNKNOWN if role is None else AskerKind(role))


class Refusal(msgspec.Struct, frozen=True, kw_only=True):
    """Why a request is turned away, in words or as a fact."""

    status: int
    why: str | Fact

    @property
    def reason(self) -> str:
        return render(self.why) if isinstance(self.why, Fact) else self.why


class Access:
    """`names` are the host names and addresses by which this server may be called."""

    def __init__(
        self,
        names: tuple[str, ...],
        port: int,
        operator_token: str,
        viewer_token: str,
        session_key: str,
        *,
        is_local: bool,
        is_encrypted: bool = False,
    ) -> None:
        self.is_local, self.is_encrypted = is_local, is_encrypted
        self.cookie = f"agribot_{port}"
        self._hosts = {f"{name}:{port}".lower() for name in (*LOCAL_NAMES, *names)}
        if port in {80, 443}:
            self._hosts |= {name.lower() for name in (*LOCAL_NAMES, *names)}
        self._tokens: dict[Role, str] = {"operator": operator_token, "viewer": viewer_token}
        self._signer = Signer(f"{session_key}{read_boot_id()}")
        self._guesses = Guesses()

    def check(
        self, kind: str, method: str, path: str, headers: Mapping[str, str]
    ) -> Caller | Refusal:
        """Judge one request; `kind` is "http" or "websocket", header names are lower case."""
        host = headers.get("host", "").lower()
        if host not in self._hosts:
            reason = f"host '{host[:80]}' is not a name of this robot; use the address it printed"
            return Refusal(status=403, why=f"{reason}, or start it with --allow-host")
        origin = headers.get("origin")
        if origin is not None and origin.lower() not in {f"http://{host}", f"https://{host}"}:
            return Refusal(
                status=403, why=f"origin '{origin[:80]}' is not this page; open the robot's own"
            )
        bearer = self._bearer(headers)
        if isinstance(bearer, Refusal):
            return bearer
        is_asking_only = kind == "http" and method in {"GET", "HEAD"}
        if origin is None and bearer is None and not is_asking_only:
            return Refusal(
                status=401,
                why="no origin and no token; a program sends 'Authorization: Bearer <token>'",
            )
        caller = bearer or self._visitor(headers)
        if caller.role is None and not _is_open(path):
            return Refusal(status=401, why=TokenNeeded())
        return caller

    def login(self, token: str, address: str) -> str | Refusal:
        """Make the cookie of a new session for the owner of a token.

        The right token counts at once, also while others guess from the same address: behind a
        proxy all share one. Only wrong tokens are counted and have to wait.
        """
        role = self._role_of(token)
        if role is not None:
            return self._signer.cookie(Session(secrets.token_urlsafe(18), role, time.monotonic()))
        if self._guesses.is_too_many(address, time.monotonic()):
            return Refusal(status=429, why=TokensWrong())
        return Refusal(status=401, why=TokenWrong())

    def visit(self) -> str:
        """Make the cookie of a browser on this machine; empty on the network, before a login."""
        if not self.is_local:
            return ""
        return self._signer.cookie(Session(secrets.token_urlsafe(18), "operator", time.monotonic()))

    def _visitor(self, headers: Mapping[str, str]) -> Caller:
        now_s = time.monotonic()
        session = self._signer.session(self._cookie_of(headers), now_s)
        if session is None:
            return Caller(session="", role="operator" if self.is_local else None)
        renewed = ""
        if now_s - session.at_s > RENEW_AFTER_S:
            renewed = self._signer.cookie(session._replace(at_s=now_s))
        return Caller(session=session.id, role=session.role, cookie=renewed)

    def _bearer(self, headers: Mapping[str, str]) -> Caller | Refusal | None:
        scheme, _, token = headers.get("authorization", "").partition(" ")
        if scheme.lower() != "bearer":
            return None
        role = self._role_of(token.strip())
        if role is None:
            return Refusal(status=401, why=TokenWrong())
        digest = hashlib.sha256(f"{token}{headers.get('user-agent', '')}".encode()).hexdigest()
        return Caller(session=f"bearer-{digest[:16]}", role=role)

    def _role_of(self, token: str) -> Role | None:
        found: Role | None = None
        for role, known in self._tokens.items():
            if secrets.compare_digest(token.encode(), known.encode()):
                found = role
        return found

    def _cookie_of(self, headers: Mapping[str, str]) -> str:
        jar: SimpleCookie = SimpleCookie()
        try:
            jar.load(headers.get("cookie", ""))
        except CookieError:
            return ""
        morsel = jar.get(self.cookie)
        return morsel.value if morsel else ""


def read_boot_id() -> str:
    """Another one each time that the machine starts; empty where the system has none.

    Sessions are as old as the clock since the machine was started says, and that clock begins
    anew with it: sealed with the start's id, none of an earlier start can become young again.
    """
    try:
        return BOOT_ID.read_text(encoding="ascii").strip()
    except OSError:
        return ""


def _is_open(path: str) -> bool:
    """Whether a browser needs this path for the login; none of these has data of the robot."""
    return path in OPEN_PATHS or path == "/api/v1/session" or path.startswith(OPEN_FOLDERS)
