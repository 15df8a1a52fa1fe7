"""The settings of a run as a page shows them: value, default, range, unit."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import msgspec

from agribot.core.config import RunConfig
from agribot.core.errors import ConfigError, add_advice
from agribot.core.messages import LIVE_SETTINGS, ChangeSetting
from agribot.core.messages.requests import find_live_setting
from agribot.ui import wire

_UNITS = (
    ("_radps", "rad/s"), ("_mps", "m/s"), ("_mps2", "m/s²"), ("_hz", "Hz"), ("_deg", "°"),
    ("_rad", "rad"), ("_m2", "m²"), ("_px", "px"), ("_nm", "Nm"), ("_m", "m"), ("_s", "s"),
    ("_ratio", ""),
)  # fmt: skip
LIVE = "Counts at once, for this run."
NOT_LIVE = "Taken when the run starts; give it to the next run with --set."


def show_settings(config: RunConfig) -> list[wire.SettingGroup]:
    """List the settings of a run by group.

    Those that are `live` may change under way: the change goes into the recording as an
    operator's event, so that a replay repeats it.
    """
    groups: dict[str, list[wire.Setting]] = {"run": []}
    for field in msgspec.structs.fields(RunConfig):
        value = getattr(config, field.name)
        if isinstance(value, msgspec.Struct):
            groups[field.name] = [
                _show(f"{field.name}.{inner.name}", inner, getattr(value, inner.name))
                for inner in msgspec.structs.fields(type(value))
            ]
        else:
            groups["run"].append(_show(field.name, field, value))
    return [wire.SettingGroup(name=name, keys=keys) for name, keys in groups.items()]


def show_changes(groups: list[wire.SettingGroup], changed: dict[str, float]) -> None:
    """Put into the settings what was changed under way, by the numbers of operators' events."""
    for setting in (setting for group in groups for setting in group.keys):
        if setting.key in changed:
            number = changed[setting.key]
            setting.value = bool(number) if setting.type == "boolean" else number


def make_change(config: RunConfig, key: str, value: object) -> ChangeSetting:
    """Make the request of a value.

    Raises: ConfigError: not a live setting, or the value does not fit it.
    """
    setting = find_live_setting(key)
    if setting is None:
        raise ConfigError(NOT_LIVE)
    group_name, _, name = key.partition(".")
    group = getattr(config, group_name)
    try:
        changed = msgspec.convert({**msgspec.to_builtins(group), name: value}, type(group))
    except msgspec.ValidationError as error:
        fact = f"{key} = {value!r}: {str(error).partition(' - ')[0]}"
        raise ConfigError(add_advice(fact, "give such a value")) from error
    number = float(getattr(changed, name))
    if not math.isfinite(number):
        raise ConfigError(f"{key} = {value!r}: not finite; give a finite number")
    return ChangeSetting(setting=setting, value=number)


def _show(key: str, field: msgspec.structs.FieldInfo, value: object) -> wire.Setting:
    kind = _kind(field.type)
    default = None if field.default is msgspec.NODEFAULT else msgspec.to_builtins(field.default)
    return wire.Setting(
        key=key,
        value=msgspec.to_builtins(value),
        default=default,
        type=kind.type,
        unit=next((unit for ending, unit in _UNITS if key.endswith(ending)), ""),
        live=key in LIVE_SETTINGS,
        about=LIVE if key in LIVE_SETTINGS else NOT_LIVE,
        min=kind.min,
        max=kind.max,
        choices=kind.choices,
    )


class _Kind(NamedTuple):
    type: wire.SettingType
    min: float | None = None
    max: float | None = None
    choices: list[str] | None = None


def _kind(type_: Any) -> _Kind:
    """Describe what a page lets a person enter, with the range or the choices."""
    info = msgspec.inspect.type_info(type_)
    if isinstance(info, msgspec.inspect.UnionType):
        info = next(t for t in info.types if not isinstance(t, msgspec.inspect.NoneType))
    if isinstance(info, msgspec.inspect.BoolType):
        return _Kind("boolean")
    if isinstance(info, msgspec.inspect.FloatType | msgspec.inspect.IntType):
        low = info.ge if info.ge is not None else info.gt
        high = info.le if info.le is not None else info.lt
        return _Kind("number", low, high)
    if isinstance(info, msgspec.inspect.LiteralType):
        return _Kind("choice", choices=[str(value) for value in info.values])
    return _Kind("string")
