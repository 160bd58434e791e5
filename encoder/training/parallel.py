"""Data-parallel training under `torchrun`: one process for each GPU, or a few gloo processes on
CPUs.

Every process draws its own part of a batch; `average_gradients` makes all take the same step.
Without torchrun there is one process, and nothing here has any effect.
"""

import os
from collections.abc import Iterable
from dataclasses import dataclass

import torch
from torch import Tensor, distributed


@dataclass(frozen=True)
class Ranks:
    """Rank of this process, and the number of processes."""

    rank: int = 0
    world: int = 1

    @property
    def leads(self) -> bool:
        """Whether this process prints and writes files."""
        return self.rank == 0


def join(device: str) -> Ranks:
    """Join the other processes started by torchrun: NCCL between GPUs, gloo between CPUs."""
    world = int(os.environ.get("WORLD_SIZE", "1"))
    if world == 1:
        return Ranks()
    if not distributed.is_initialized():
        distributed.init_process_group("nccl" if device.startswith("cuda") else "gloo")
    return Ranks(distributed.get_rank(), world)


def local_device(device: str) -> str:
    """ "cuda" -> the GPU of this process, e.g. cuda:1; other devices unchanged."""
    return f"cuda:{os.environ.get('LOCAL_RANK', '0')}" if device == "cuda" else device


def wait(ranks: Ranks) -> None:
    """Wait for all processes; files that the leader wrote exist afterwards."""
    if ranks.world > 1:
        distributed.barrier()


def average_gradients(parameters: Iterable[Tensor], ranks: Ranks) -> None:
    """Average all gradients in one reduction; a missing gradient counts as zero."""
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
    """Average running statistics over the processes."""
    if ranks.world == 1:
        return
    for buffer in buffers:
        if buffer.is_floating_point():
            distributed.all_reduce(buffer)
            buffer /= ranks.world
