"""Data parallel training under `torchrun`: one process a GPU, or a few gloo processes on CPUs.

Every process draws its own part of a batch; `average_gradients` makes their steps the same step.
Without torchrun there is one process and nothing here does anything.
"""

import os
from collections.abc import Iterable
from dataclasses import dataclass

import torch
from torch import Tensor, distributed


@dataclass(frozen=True)
class Ranks:
    """Which of how many processes this one is."""

    rank: int = 0
    world: int = 1

    @property
    def leads(self) -> bool:
        """The process that prints and writes files."""
        return self.rank == 0


def join(device: str) -> Ranks:
    """Meet the other processes that torchrun started: NCCL between GPUs, gloo between CPUs."""
    world = int(os.environ.get("WORLD_SIZE", "1"))
    if world == 1:
        return Ranks()
    if not distributed.is_initialized():
        distributed.init_process_group("nccl" if device.startswith("cuda") else "gloo")
    return Ranks(distributed.get_rank(), world)


def local_device(device: str) -> str:
    """ "cuda" -> this process's GPU of the machine."""
    return f"cuda:{os.environ.get('LOCAL_RANK', '0')}" if device == "cuda" else device


def wait(ranks: Ranks) -> None:
    """Until every process has come here: files that the leader wrote exist afterwards."""
    if ranks.world > 1:
        distributed.barrier()


def average_gradients(parameters: Iterable[Tensor], ranks: Ranks) -> None:
    """One reduction of all gradients end to end; a parameter without one counts as zero."""
    if ranks.world == 1:
        return
    parameters = list(parameters)
    for p in parameters:
        if p.grad is None:
            p.grad = torch.zeros_like(p)
    flat = torch.cat([p.grad.flatten() for p in parameters if p.grad is not None])
    distributed.all_reduce(flat)
    flat /= ranks.world
    for p, part in zip(parameters, flat.split([p.numel() for p in parameters]), strict=True):
        p.grad = part.view_as(p)


def average_buffers(buffers: Iterable[Tensor], ranks: Ranks) -> None:
    """Running statistics become the mean of what the processes saw."""
    if ranks.world == 1:
        return
    for buffer in buffers:
        if buffer.is_floating_point():
            distributed.all_reduce(buffer)
            buffer /= ranks.world
