"""The borders that `bench fuzz` feeds, and how many of its inputs each gets."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from app.bench.fuzz import cameras, models, network, sessions
from app.bench.fuzz.fuzzer import Fuzzer

Make = Callable[[Fuzzer, Path], Callable[[], None]]


@dataclass(frozen=True)
class Target:
    """`make` builds the reader of one damaged input; it may write into the folder it is given."""

    make: Make
    share: float  # of all inputs
    chunk: int = 10_000  # inputs that are done or not done: a few seconds


# Whole sessions and avatars cost as much as a hundred of the others.
TARGETS = {
    "serial": Target(cameras.serial, 0.13),
    "http": Target(cameras.http, 0.12),
    "usb": Target(cameras.usb, 0.13),
    "osc": Target(network.osc, 0.12),
    "head": Target(network.head, 0.12),
    "call": Target(network.call, 0.12),
    "card": Target(sessions.card, 0.06),
    "timeline": Target(sessions.timeline, 0.07),
    "obj": Target(models.obj, 0.04),
    "ply": Target(models.ply, 0.04),
    "npz": Target(models.npz, 0.02),
    "safetensors": Target(models.safetensors, 0.028),
    "session": Target(sessions.session, 0.0015, chunk=250),
    "avatar": Target(models.avatar, 0.0005, chunk=100),
    "page": Target(network.page, 0.02),
    "scan": Target(models.scan, 0.002, chunk=100),  # the last: a target's place is part of its seed
}
