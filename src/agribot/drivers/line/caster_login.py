"""The login at a caster of corrections: from the environment or a netrc, never from a setting."""

from __future__ import annotations

import netrc
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from agribot.core.errors import ConfigError

LOGIN_VARIABLE = "AGRIBOT_NTRIP_LOGIN"
LOGIN_HELP = f"'machine HOST login USER password WORD' in ~/.netrc, or {LOGIN_VARIABLE}=USER:WORD"


class CasterLogin(NamedTuple):
    """Login of a person at a caster; it never appears in a text."""

    user: str
    password: str

    def __repr__(self) -> str:
        return "CasterLogin(...)"


def check_no_login(text: str) -> None:
    """Refuse a login where settings are, for these stand in every recording of a run.

    Raises: ConfigError: there is one; it is not repeated.
    """
    if "@" in text:
        raise ConfigError(
            f"ntrip=...@...: a login here would stand in every recording; write {LOGIN_HELP}, "
            "and leave it out here"
        )


def find_login(host: str, environment: Mapping[str, str], home: Path) -> CasterLogin | None:
    """Find the login for a caster in the environment or else in `home`/.netrc; None without one.

    Raises: ConfigError: a file that cannot be read, or half a login.
    """
    login_text = environment.get(LOGIN_VARIABLE, "")
    if login_text:
        user, colon, password = login_text.partition(":")
        if not colon or not user:
            raise ConfigError(f"{LOGIN_VARIABLE}: not a login; write USER:WORD")
        return CasterLogin(user, password)
    path = home / ".netrc"
    try:
        found = netrc.netrc(str(path)).authenticators(host)
    except FileNotFoundError:
        return None
    except netrc.NetrcParseError as error:  # its text may repeat a password
        raise ConfigError(f"{path}, line {error.lineno}: it is no netrc; see man netrc") from None
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path} cannot be read ({type(error).__name__}); fix it") from None
    return CasterLogin(found[0], found[2] or "") if found else None
