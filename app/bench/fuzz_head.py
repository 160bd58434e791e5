"""Datagrams for `bench fuzz`: what trackers send to `--head`."""

import struct
from collections.abc import Callable

from sensors.head import livelink, vmc
from sensors.head.gate import Gate
from sensors.standins.osc import bundle

STEP_NS = 5_000_000  # between two datagrams


def feed(mutate: Callable[[bytes], bytes], pick: Callable[[int], int]) -> Callable[[], None]:
    """What reads one mutated datagram; `pick` draws a number below its argument."""
    pose = (0.01, 0.02, 0.03, 0.1, 0.2, 0.3, 0.9)
    bones = [(vmc.BONE, "Neck", *pose), (vmc.BONE, "Head", *pose), (vmc.HMD, "x", *pose)]
    tracker = [(vmc.TRACKER + "position", *pose[:3]), (vmc.TRACKER + "rotation", *pose[3:6])]
    text = struct.pack(">i", 5) + b"phone"
    phone = b"\x06" + 2 * text + struct.pack(">ifiiB61f", 90, 0.5, 60, 1, 61, *[0.1] * 61)
    sent = (
        (bundle((vmc.OK, 1), (vmc.TIME, 1.5), *bones), vmc.VmcDecoder()),
        (bundle(*tracker), vmc.TrackerDecoder()),
        (phone, livelink.decode),
    )
    gate, arrival_ns = Gate("fuzz", lambda line: None), 0

    def once() -> None:
        nonlocal arrival_ns
        data, decode = sent[pick(len(sent))]
        for reading in decode(mutate(data)):
            arrival_ns += STEP_NS
            gate(reading, arrival_ns)

    return once
