"""Whether a test has failed, for fixtures that then print more details."""

from __future__ import annotations

import pytest

HAS_FAILED = pytest.StashKey[bool]()
