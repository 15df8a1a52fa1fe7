"""The implements of this program by their kind, and those that were registered."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from agribot.autonomy.implements.hoe import Hoe
from agribot.autonomy.implements.point import Pointer
from agribot.autonomy.implements.sprayer import SpotSprayer
from agribot.core.config import TreatmentConfig
from agribot.core.errors import DescriptionError
from agribot.core.implement.kind import Implement, find_registered
from agribot.core.implement.spec import ImplementSpec
from agribot.core.plugins import bind_settings

KINDS: dict[str, Callable[..., Implement]] = {
    "sprayer": SpotSprayer,
    "hoe": Hoe,
    "point": Pointer,
}


def fit_implement(
    spec: ImplementSpec, config: TreatmentConfig, plugins: Mapping[str, Any] | None = None
) -> Implement:
    """Make what decides for the implement of a robot; `plugins` are `RunConfig.plugins`.

    Raises: DescriptionError: its kind is not registered. ConfigError: its settings do not fit.
    """
    kind = find_registered(spec.kind)
    control = KINDS.get(spec.kind) if kind is None else kind.control
    if control is None:
        raise DescriptionError(
            f"nothing decides for an implement '{spec.kind}'; register its kind first"
        )
    return control(spec, config, **bind_settings(kind, plugins or {}, spec.kind))
