"""Tokens that stay the same from one start of the robot to the next."""

from __future__ import annotations

import os
import secrets
from pathlib import Path
from typing import Annotated

import msgspec

from agribot.core.errors import ConfigError

Secret = Annotated[str, msgspec.Meta(min_length=20, max_length=200, pattern=r"^[\w-]+$")]


class Tokens(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The two tokens, and the key that signs the sessions of browsers."""

    operator: Secret
    viewer: Secret
    sessions: Secret


def read_or_make_tokens(path: Path) -> Tokens:
    """Read tokens from a file that its owner alone may read; make it if it is missing.

    Raises: ConfigError: it cannot be read or made, holds no tokens, or others may read it.
    """
    try:
        if not path.exists():
            return _make(path)
        others = path.stat().st_mode & 0o077
        tokens = msgspec.json.decode(path.read_bytes(), type=Tokens)
    except OSError as error:
        reason = f"--token-file {path}: {error.strerror}; name a file in a folder of your own"
        raise ConfigError(reason) from error
    except (msgspec.DecodeError, ValueError) as error:
        reason = f"--token-file {path} holds no tokens: {error}; delete it to have new ones made"
        raise ConfigError(reason) from error
    if others:
        raise ConfigError(f"--token-file {path} can be read by others; chmod 600 {path}")
    return tokens


def _make(path: Path) -> Tokens:
    made = Tokens(
        operator=secrets.token_urlsafe(18),
        viewer=secrets.token_urlsafe(18),
        sessions=secrets.token_urlsafe(32),
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    with os.fdopen(handle, "wb") as file:
        file.write(msgspec.json.format(msgspec.json.encode(made)))
    return made
