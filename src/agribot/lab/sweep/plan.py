"""Which runs a sweep consists of: every seed with every combination of the varied settings."""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence

import msgspec

from agribot.core import config
from agribot.core.errors import ConfigError
from agribot.sim.faults.schedule import read_faults

MOST_RUNS = 100_000
UNSAFE = re.compile(r"[^A-Za-z0-9._=,+-]+")


class SweepJob(msgspec.Struct, frozen=True, kw_only=True):
    """One run. `settings` are what is varied, `fixed` what all runs share; both as `a.b=c`."""

    name: str  # also of its folder
    profile: str
    seed: int
    fixed: tuple[str, ...]
    settings: tuple[str, ...]

    def config(self) -> config.RunConfig:
        """Resolve the settings that `agribot run` with the same options would have.

        Raises: ConfigError: one of them is unknown or out of range.
        """
        return config.load(self.profile, [*self.fixed, *self.settings, f"seed={self.seed}"])


def plan(
    profile: str, seeds: Sequence[int], fixed: Sequence[str], varied: Sequence[str]
) -> tuple[SweepJob, ...]:
    """List all runs in the order of their names, and check every one.

    Raises: ConfigError: a setting is wrong, is varied twice, or there are too many runs.
    """
    axes = [_parse_axis(text) for text in varied]
    keys = [axis[0].partition("=")[0] for axis in axes] + ["seed"]
    double = {key for key in keys if keys.count(key) > 1}
    if double:
        raise ConfigError(
            f"--vary {double.pop()}: given twice; give each setting once, and seeds with --seeds"
        )
    combinations = list(itertools.product(*axes))
    count = len(combinations) * len(seeds)
    if count > MOST_RUNS:
        raise ConfigError(f"{count} runs are more than {MOST_RUNS}; vary less in one sweep")
    digits = len(str(count))
    jobs = []
    for number, (settings, seed) in enumerate(itertools.product(combinations, seeds), 1):
        words = [str(number).zfill(digits), *settings, f"seed={seed}"]
        jobs.append(
            SweepJob(
                name=UNSAFE.sub("_", "-".join(words))[:120],
                profile=profile,
                seed=seed,
                fixed=tuple(fixed),
                settings=settings,
            )
        )
    for job in jobs:
        read_faults(job.config())
    return tuple(jobs)


def read_seeds(text: str) -> tuple[int, ...]:
    """Read seeds from a list such as `1-8` or `1,3,10-12`, each once, in order.

    Raises: ConfigError: it is no such list.
    """
    seeds: dict[int, None] = {}
    for word in text.split(","):
        found = re.fullmatch(r"(\d+)(?:-(\d+))?", word.strip())
        first, last = (int(found[1]), int(found[2] or found[1])) if found else (1, 0)
        if not first <= last < first + MOST_RUNS:
            raise ConfigError(
                f"--seeds {text}: not seeds; write numbers and ranges, as in 1-8 or 1,3,10-12"
            )
        seeds |= dict.fromkeys(range(first, last + 1))
    return tuple(seeds)


def _parse_axis(text: str) -> list[str]:
    key, _, values = text.partition("=")
    words = [word.strip() for word in values.split(",")]
    if not key.strip() or not all(words):
        raise ConfigError(f"--vary {text}: not a setting with values; write key.subkey=1,2,3")
    return [f"{key.strip()}={word}" for word in words]
