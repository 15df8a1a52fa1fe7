"""Print docs/presets.md: presets of sensors and of worlds, from their files.

`make pages` writes all such pages.
"""

from __future__ import annotations

import sys
from typing import Any

import msgspec

from agribot.description.conditions import Preset, list_condition_presets, load_condition_preset
from agribot.sim.sensors.presets import list_presets, load_preset

HEAD = """# Presets of the simulator

Written by `make pages` from the files.

## Sensors

`--sensors NAME` chooses the errors of all [simulated](simulator.md) sensors.

| preset | what |
|---|---|
"""
WORLDS = """
## Worlds

`--preset NAME`, or a TOML file of yours with these keys, chooses what each seed draws: 1 sigma
where a name says `std`, pairs are drawn between. `report.json` has the drawn `conditions`.

"""
EXACT = "kind"


def page() -> str:
    sensors = "".join(f"| `{name}` | {load_preset(name).about} |\n" for name in list_presets())
    return HEAD + sensors + WORLDS + _write_worlds()


def _write_worlds() -> str:
    """Put the presets side by side, with the keys in which they differ from an exact world."""
    presets = {name: load_condition_preset(name) for name in list_condition_presets()}
    about = "".join(f"- `{name}`: {preset.about}\n" for name, preset in presets.items())
    drawn = [preset for name, preset in presets.items() if name != EXACT]
    names = [f"`{name}`" for name in presets if name != EXACT]
    head = f"\n| key | {' | '.join(names)} |\n|---|{'---|' * len(names)}\n"
    return about + head + "".join(_write_row(key, drawn) for key in Preset.__struct_fields__[1:])


def _write_row(key: str, presets: list[Preset]) -> str:
    values = (_show(getattr(preset, key)) for preset in presets)
    return f"| `{key}` | {' | '.join(values)} |\n"


def _show(value: Any) -> str:
    if isinstance(value, tuple):
        joint = "–" if isinstance(value[0], float) else ", "
        return joint.join(map(_show, dict.fromkeys(value)))
    return f"{value:g}" if isinstance(value, float) else str(msgspec.to_builtins(value))


if __name__ == "__main__":
    sys.stdout.write(page())
