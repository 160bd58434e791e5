"""What every Source must keep, whatever is behind it: replay, synthetic signal, device."""

from collections.abc import Callable

import pytest

from sensors.types import AudioPacket, EyePacket, Packet, Source


def drain(source: Source, wait: Callable[[], None] = lambda: None) -> list[Packet]:
    packets: list[Packet] = []
    for _ in range(100_000):
        if source.exhausted:
            return packets
        packets += source.poll()
        wait()
    raise AssertionError("the source never ends")


def check_source(
    source: Source, wait: Callable[[], None] = lambda: None, *, live: bool = False
) -> list[Packet]:
    """Order, drop accounting, close twice, reopen. `wait` lets time pass between polls.

    No two runs of a `live` source are alike, so only a recorded one is compared with itself.
    """
    with pytest.raises(RuntimeError):
        source.poll()
    source.open()
    assert source.dropped == 0
    packets = drain(source, wait)
    dropped = source.dropped
    assert source.poll() == []
    sounds = [p for p in packets if isinstance(p, AudioPacket)]
    assert bool(sounds) == source.info.audio
    for a, b in zip(sounds, sounds[1:], strict=False):
        assert b.first_sample >= a.first_sample + len(a.samples)
        assert b.t_ns > a.t_ns
    skipped = 0
    for eye in (0, 1):
        pictures = [p for p in packets if isinstance(p, EyePacket) and p.eye == eye]
        assert not pictures or eye in source.info.eyes
        for a, b in zip(pictures, pictures[1:], strict=False):
            assert b.counter > a.counter
            assert b.t_ns >= a.t_ns
            skipped += b.counter - a.counter - 1
    assert dropped >= skipped
    source.close()
    source.close()
    with pytest.raises(RuntimeError):
        source.poll()
    source.open()
    again = drain(source, wait)
    assert bool(again) == bool(packets)
    if not live:
        assert len(again) == len(packets)
        assert source.dropped == dropped
    source.close()
    return packets
