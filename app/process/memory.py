"""Memory that processes share: anonymous on Linux, named elsewhere.

A handle is text that another process of this run can open: "fd:7" is a descriptor that it inherits
(see app.process.child), "name:..." a name that the system knows.
"""

import mmap
import os
import sys
from multiprocessing import resource_tracker
from multiprocessing.shared_memory import SharedMemory
from typing import Protocol

from sensors.types import InputError


class SharedBlock(Protocol):
    """Zeros at first; it lives as long as anybody has it open."""

    handle: str

    @property
    def buffer(self) -> mmap.mmap | memoryview: ...
    def close(self) -> None:
        """Let no other process open it any more; arrays on the buffer stay valid."""
        ...


def create(size: int) -> SharedBlock:  # bytes
    if sys.platform == "linux":
        return AnonymousBlock(os.memfd_create("livedrive"), size)
    return NamedBlock(None, size)


def attach(handle: str, size: int) -> SharedBlock:
    """What another process created. Raises InputError where it is gone."""
    kind, _, word = handle.partition(":")
    if kind == "fd":
        return AnonymousBlock(int(word), size)
    if kind == "name":
        return NamedBlock(word, size)
    raise InputError(f"shared memory: expected fd:NUMBER or name:NAME, got {handle!r}")


def inherited(handle: str) -> tuple[int, ...]:
    """The descriptors that a child needs to open the handle."""
    kind, _, word = handle.partition(":")
    return (int(word),) if kind == "fd" else ()


class AnonymousBlock:
    """Not visible to other processes; freed when its last user ends, even by a crash."""

    def __init__(self, descriptor: int, size: int) -> None:
        if os.fstat(descriptor).st_size < size:
            os.ftruncate(descriptor, size)
        self.handle, self._descriptor = f"fd:{descriptor}", descriptor
        self.buffer = mmap.mmap(descriptor, size)

    def close(self) -> None:
        os.close(self._descriptor)


class NamedBlock:
    """For this user's processes alone, under a random name."""

    def __init__(self, name: str | None, size: int) -> None:
        """Make one, or open the one of this name."""
        try:
            self._memory = _Memory(name, create=name is None, size=size)
        except FileNotFoundError:
            raise InputError(
                f"shared memory: expected {name}, got none; the run that made it has ended"
            ) from None
        if name is not None and sys.platform != "win32":
            # The tracker of the process that opens it would delete it when that process ends.
            resource_tracker.unregister(f"/{self._memory.name}", "shared_memory")
        self._owned = name is None
        self.handle = f"name:{self._memory.name}"

    @property
    def buffer(self) -> memoryview:
        buffer = self._memory.buf
        assert buffer is not None  # until it is closed
        return buffer

    def close(self) -> None:
        if self._owned:
            self._owned = False
            self._memory.unlink()


class _Memory(SharedMemory):
    def __del__(self) -> None:
        """The system unmaps it at the process's end: arrays may outlive this object."""
