"""Sessions of browsers as cookies that the server signs and need not remember."""

from __future__ import annotations

import hashlib
import hmac
import math
from typing import Literal, NamedTuple

SESSION_LIFE_S = 12 * 3600.0  # time without a request after which a browser needs a token again
RENEW_AFTER_S = 600.0  # age at which a request is answered with a cookie that begins anew


class Session(NamedTuple):
    """`at_s` is when it was last used, by the clock since this machine was started."""

    id: str
    role: Literal["operator", "viewer"]
    at_s: float


class Signer:
    """Signs and checks sessions with its key; it has no clock, the caller passes the time."""

    def __init__(self, key: str) -> None:
        self._key = key.encode()

    def cookie(self, session: Session) -> str:
        text = f"{session.role}.{session.at_s:.0f}.{session.id}"
        return f"{text}.{self._seal(text)}"

    def session(self, cookie: str, now_s: float) -> Session | None:
        """Return the session, None if the cookie is forged or was not used for too long."""
        text, _, seal = cookie.rpartition(".")
        if not hmac.compare_digest(seal.encode(), self._seal(text).encode()):
            return None
        role, at_s, id = text.split(".", 2)
        age_s = now_s - float(at_s)
        if not -1.0 <= age_s < SESSION_LIFE_S or not math.isfinite(age_s):
            return None
        return Session(id, "operator" if role == "operator" else "viewer", float(at_s))

    def _seal(self, text: str) -> str:
        return hmac.new(self._key, text.encode(), hashlib.sha256).hexdigest()
