"""One process or several that train one network together, on CPUs or GPUs.

`torchrun --nproc_per_node N` starts several and gives each its rank. Each draws its own images;
their gradients are averaged in every step, so that N processes see N times the batch.
"""

from __future__ import annotations

import gc
import os
from collections.abc import Callable
from datetime import timedelta
from typing import TypeVar

import msgspec
import torch

# Its functions take the group of the moment they are defined as a default, and PyTorch imports
# them with the first network trained together: without this line that group is never let go.
import torch.distributed.nn
from torch import distributed, nn

from agribot.core.errors import ConfigError

DEVICES = ("auto", "cpu", "cuda")
# The others wait while the first one draws its images.
PATIENCE = timedelta(hours=12)

Result = TypeVar("Result")


class TrainingGroup(msgspec.Struct, frozen=True, kw_only=True):
    """One process among those that train together: `rank` 0 also writes and prints."""

    rank: int = 0
    size: int = 1
    device: str = "cpu"

    @property
    def is_leader(self) -> bool:
        return self.rank == 0

    def name_device(self) -> str:
        """Name the GPU that the network is trained on; empty without one."""
        return "" if self.device == "cpu" else torch.cuda.get_device_name(self.device)

    def run_leader_first(self, work: Callable[[], Result]) -> Result:
        """Call in every process, in the others after the first one, which may write files."""
        if not self.is_leader:
            distributed.barrier()
        result = work()
        if self.is_leader and self.size > 1:
            distributed.barrier()
        return result

    def average_gradients(self, network: nn.Module) -> nn.Module:
        """Wrap the network so that its gradients are the mean of all processes."""
        if self.size == 1:
            return network
        return nn.parallel.DistributedDataParallel(network)


def use_threads(count: int) -> None:
    """Set the number of threads of this process."""
    torch.set_num_threads(count)


def join_group(device: str = "auto") -> TrainingGroup:
    """Join the other processes that torchrun started, if any.

    Raises: ConfigError: no such device here.
    """
    rank, size = int(os.environ.get("RANK", "0")), int(os.environ.get("WORLD_SIZE", "1"))
    has_gpu = torch.cuda.is_available()
    if device == "cuda" and not has_gpu:
        raise ConfigError("--device cuda: PyTorch finds no GPU here; leave the option out")
    if has_gpu and device != "cpu":
        index = int(os.environ.get("LOCAL_RANK", "0"))
        torch.cuda.set_device(index)
        torch.backends.cudnn.benchmark = True  # all batches have one size
        torch.set_float32_matmul_precision("high")
        device = f"cuda:{index}"
    else:
        device = "cpu"
    if size > 1 and not distributed.is_initialized():
        backend = "gloo" if device == "cpu" else "nccl"
        distributed.init_process_group(backend, timeout=PATIENCE)
    return TrainingGroup(rank=rank, size=size, device=device)


def leave_group() -> None:
    """Leave the other processes in good order, once nothing trains together any more.

    The group's threads end with the last that holds it. One that still runs while Python shuts
    down, and lets go of a tensor then, aborts the process.
    """
    if distributed.is_initialized():
        gc.collect()
        distributed.destroy_process_group()
