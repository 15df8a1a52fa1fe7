"""The address of a ROS 1 master."""

from __future__ import annotations

import re
from urllib.parse import urlsplit

from agribot.core.errors import ConfigError

MASTER = "http://127.0.0.1:11311"


def check_master(uri: str) -> str:
    """Return the address.

    Raises: ConfigError: not the address of a ROS 1 master.
    """
    if not _is_address(uri):
        raise ConfigError(
            f"ROS master {uri[:80]}: not an address; write http://HOST:PORT, as in {MASTER}"
        )
    return uri


def _is_address(uri: str) -> bool:
    """Return whether a URI is a host, a port or none, and nothing behind them."""
    try:
        parts = urlsplit(uri)
        is_port = parts.port != 0 and not parts.netloc.endswith(":")
    except ValueError:
        return False
    is_host = bool(parts.hostname) and "@" not in parts.netloc and not re.search(r"\s", uri)
    is_bare = parts.path in {"", "/"} and not (parts.query or parts.fragment)
    return parts.scheme in {"http", "https"} and is_host and is_port and is_bare
