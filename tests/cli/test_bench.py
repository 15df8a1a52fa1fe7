"""`agribot bench`: every benchmark by name, and all of them in one."""

from __future__ import annotations

import json

import pytest

from agribot.cli.main import main
from agribot.cli.tools import bench, bench_all

SIM = ("agribot.cli.tools.bench_sim", ("--only", "network_ms"))


def last_line(capsys: pytest.CaptureFixture[str]) -> dict[str, object]:
    found: dict[str, object] = json.loads(capsys.readouterr().out.splitlines()[-1])
    return found


@pytest.mark.parametrize(
    ("words", "named"),
    [
        ("perception --networks unknown", "--networks unknown: not known; there are"),
        ("perception --size 100x64", "32"),
        ("perception --frames 0", "--frames 0"),
        ("sim --only speed", "--only speed: not known; there are"),
        ("missions --profiles farm,moon", "--profiles moon: not known; there are farm"),
        ("closed-loop --fields tulips", "--fields tulips: not known; there are"),
        ("closed-loop --lights disco", "disco"),
        ("closed-loop --heights tall", "tall"),
        ("closed-loop --heights 9", "0.2 to 3"),
        ("closed-loop --seconds 0", "--seconds 0"),
        ("in-row --length 1", "--length 1: out of range; give 2 to 100 m"),
        ("in-row --seconds 0", "--seconds 0: out of range; give 1 to 3600"),
        ("plants --scenes jungle", "--scenes jungle: not known; there are beet-4-9"),
        ("plants --preset moon", "unknown preset 'moon'"),
    ],
)
def test_what_cannot_be_measured_is_refused_by_name(
    words: str, named: str, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("torch")
    assert main(["bench", *words.split()]) == 2
    assert named in capsys.readouterr().err


def test_all_goes_on_after_a_benchmark_that_cannot_run(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    broken = ("agribot.cli.tools.bench_sim", ("--only", "nothing"))
    absent = ("agribot.cli.bench_of_nothing", ())
    monkeypatch.setattr(bench_all, "SHORT", {"broken": broken, "absent": absent, "sim": SIM})
    assert main(["bench", "all", "--json"]) == 1
    card = last_line(capsys)
    assert "nothing" in str(card["broken"])
    assert "bench_of_nothing" in str(card["absent"])
    assert isinstance(card["sim"], dict)
    assert card["sim"]["network_ms"] > 0.0


def test_the_short_forms_are_options_that_the_benchmarks_know() -> None:
    import argparse

    for module_name, short in bench_all.SHORT.values():
        parser = argparse.ArgumentParser()
        bench.add_options(parser, module_name)
        assert parser.parse_args([*short, "--json"]).json
