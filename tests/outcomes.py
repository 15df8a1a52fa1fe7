"""Whether a test has failed, for fixtures that then tell more of what it looked at."""

from __future__ import annotations

import pytest

HAS_FAILED = pytest.StashKey[bool]()
