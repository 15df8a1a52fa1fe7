"""The settings of a run as a page shows them: value, default, range, unit."""

from __future__ import annotations

import math
from typing import Any

import msgspec

from agribot.core.config import RunConfig
from agribot.core.errors import ConfigError
from agribot.core.messages import LIVE_SETTINGS

_UNITS = (
    ("_radps", "rad/s"), ("_mps", "m/s"), ("_mps2", "m/s²"), ("_hz", "Hz"), ("_deg", "°"),
    ("_rad", "rad"), ("_m2", "m²"), ("_px", "px"), ("_nm", "Nm"), ("_m", "m"), ("_s", "s"),
    ("_ratio", ""),
)  # fmt: skip
LIVE = "Counts at once, for this run."
NOT_LIVE = "Taken when the run starts; give it to the next run with --set."


def described(config: RunConfig) -> list[dict[str, Any]]:
    """Groups of settings. Those that are `live` may change under way: the change goes into the
    recording as an operator's event, so that a replay repeats it.
    """
    groups: dict[str, list[dict[str, Any]]] = {"run": []}
    for field in msgspec.structs.fields(RunConfig):
        value = getattr(config, field.name)
        if isinstance(value, msgspec.Struct):
            groups[field.name] = [
                _key(f"{field.name}.{inner.name}", inner, getattr(value, inner.name))
                for inner in msgspec.structs.fields(type(value))
            ]
        else:
            groups["run"].append(_key(field.name, field, value))
    return [{"name": name, "keys": keys} for name, keys in groups.items()]


def show_changes(groups: list[dict[str, Any]], changed: dict[str, float]) -> None:
    """Put into `described` what was changed under way, by the numbers of operators' events."""
    for key in (key for group in groups for key in group["keys"]):
        if key["key"] in changed:
            number = changed[key["key"]]
            key["value"] = bool(number) if key["type"] == "boolean" else number


def live_value(config: RunConfig, key: str, value: object) -> float:
    """The value as an operator's event carries it.

    Raises: ConfigError: not a live setting, or the value does not fit it.
    """
    if key not in LIVE_SETTINGS:
        raise ConfigError(NOT_LIVE)
    group_name, _, name = key.partition(".")
    group = getattr(config, group_name)
    try:
        changed = msgspec.convert({**msgspec.to_builtins(group), name: value}, type(group))
    except msgspec.ValidationError as error:
        raise ConfigError(f"{key} = {value!r}: {str(error).partition(' - ')[0]}") from error
    number = float(getattr(changed, name))
    if not math.isfinite(number):
        raise ConfigError(f"{key} = {value!r}: must be finite")
    return number


def _key(key: str, field: msgspec.structs.FieldInfo, value: object) -> dict[str, Any]:
    kind, limits = _kind(field.type)
    default = None if field.default is msgspec.NODEFAULT else msgspec.to_builtins(field.default)
    unit = next((unit for ending, unit in _UNITS if key.endswith(ending)), "")
    return {
        "key": key,
        "value": msgspec.to_builtins(value),
        "default": default,
        "type": kind,
        "unit": unit,
        "live": key in LIVE_SETTINGS,
        "about": LIVE if key in LIVE_SETTINGS else NOT_LIVE,
        "min": None,
        "max": None,
        "choices": None,
        **limits,
    }


def _kind(type_: Any) -> tuple[str, dict[str, Any]]:
    """number, boolean, choice or string, with the range or the choices."""
    info = msgspec.inspect.type_info(type_)
    if isinstance(info, msgspec.inspect.UnionType):
        info = next(t for t in info.types if not isinstance(t, msgspec.inspect.NoneType))
    if isinstance(info, msgspec.inspect.BoolType):
        return "boolean", {}
    if isinstance(info, msgspec.inspect.FloatType | msgspec.inspect.IntType):
        low = info.ge if info.ge is not None else info.gt
        high = info.le if info.le is not None else info.lt
        return "number", {"min": low, "max": high}
    if isinstance(info, msgspec.inspect.LiteralType):
        return "choice", {"choices": list(info.values)}
    return "string", {}
