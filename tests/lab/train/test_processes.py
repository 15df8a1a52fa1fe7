from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from datetime import timedelta
from pathlib import Path

import pytest
import torch
from torch import Tensor

from agribot.cli.data.train import run
from agribot.core.errors import ConfigError
from agribot.lab.train.architectures import ARCHITECTURES
from agribot.lab.train.processes import TrainingGroup, join_group, leave_group
from tests import nightly
from tests.lab.train import trained_together
from tests.lab.train.command_line import parsed
from tests.ros.live import free_port

ROOT = Path(__file__).parents[3]


def train_with_one_more_process(out: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Train here, together with another process, both with the environment of torchrun."""
    place = {"MASTER_ADDR": "127.0.0.1", "MASTER_PORT": str(free_port()), "WORLD_SIZE": "2"}
    words = [sys.executable, "-m", trained_together.__name__, str(out)]
    monkeypatch.setattr("agribot.lab.train.processes.PATIENCE", timedelta(minutes=3))
    with monkeypatch.context() as here:
        for name, value in {**place, "RANK": "0"}.items():
            here.setenv(name, value)
        with subprocess.Popen(words, cwd=ROOT, env=os.environ | {"RANK": "1"}) as other:
            try:
                trained_together.main(out)
                assert other.wait(180) == 0
            finally:
                other.kill()


def train_in_two_processes(out: Path, _: pytest.MonkeyPatch) -> None:
    launcher = ["-m", "torch.distributed.run", "--standalone", "--nproc_per_node", "2"]
    words = [sys.executable, *launcher, "-m", trained_together.__name__, str(out)]
    done = subprocess.run(
        words, cwd=ROOT, env=os.environ | {"OMP_NUM_THREADS": "1"}, capture_output=True, check=False
    )
    assert done.returncode == 0, done.stderr.decode()


def weights(path: Path) -> dict[str, Tensor]:
    state: dict[str, Tensor] = torch.load(path, weights_only=True)
    return state


def test_the_second_process_joins_averages_gradients_and_waits_for_the_first(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """With a meeting that only notes what is asked of it."""
    said: list[str] = []
    for name in ("init_process_group", "barrier", "destroy_process_group"):
        monkeypatch.setattr(
            torch.distributed, name, lambda *words, name=name, **_: said.append(f"{name}{words}")
        )
    monkeypatch.setattr(torch.distributed, "is_initialized", lambda: bool(said))
    monkeypatch.setattr(
        torch.nn.parallel, "DistributedDataParallel", lambda network: ("averaged", network)
    )
    for rank, order in (("1", ["barrier()", "work"]), ("0", ["work", "barrier()"])):
        monkeypatch.setenv("RANK", rank)
        monkeypatch.setenv("WORLD_SIZE", "2")
        said.clear()
        group = join_group("cpu")
        assert (group.rank, group.size, group.is_leader) == (int(rank), 2, rank == "0")
        assert said == ["init_process_group('gloo',)"]
        assert join_group("cpu") == group and len(said) == 1, "a process joins once"
        network = torch.nn.Linear(1, 1)
        averaged: object = group.average_gradients(network)
        assert averaged == ("averaged", network)
        group.run_leader_first(lambda: said.append("work"))
        assert said[1:] == order
        leave_group()
        assert said[-1] == "destroy_process_group()"


@nightly.by_day(
    "test_the_second_process_joins_averages_gradients_and_waits_for_the_first",
    "test_a_process_alone_needs_no_meeting",
)
@pytest.mark.parametrize("train", [train_with_one_more_process, train_in_two_processes])
@pytest.mark.slow
def test_two_processes_learn_what_one_learns_from_the_doubled_batch(
    train: Callable[[Path, pytest.MonkeyPatch], None],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(ARCHITECTURES, "plain", trained_together.PLAIN)
    train(tmp_path / "two.pt", monkeypatch)
    trained_together.main(tmp_path / "one.pt")
    first, second = weights(tmp_path / "two-0.pt"), weights(tmp_path / "two-1.pt")
    alone = weights(tmp_path / "one-0.pt")
    assert all(torch.equal(first[name], second[name]) for name in first)
    for name, value in alone.items():
        assert torch.allclose(first[name], value, atol=1e-4), name
    assert len(list(tmp_path.glob("*-training/checkpoint.pt"))) == 2


def test_a_process_alone_needs_no_meeting() -> None:
    group = join_group("cpu")
    assert (group.rank, group.size, group.device, group.is_leader) == (0, 1, "cpu", True)
    assert group.run_leader_first(lambda: "done") == "done"


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU")
def test_a_gpu_that_is_not_there_is_named() -> None:
    with pytest.raises(ConfigError, match="--device cuda"):
        join_group("cuda")


def test_several_processes_need_a_number_of_steps(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "agribot.lab.train.processes.join_group", lambda device: TrainingGroup(size=2)
    )
    monkeypatch.setattr("agribot.cli.data.train._make_source", lambda args, device: None)
    monkeypatch.setattr("torch.distributed.barrier", lambda: None)
    with pytest.raises(ConfigError, match="--steps"):
        run(parsed("--minutes", "1", "--out", str(tmp_path)))
