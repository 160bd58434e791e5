"""OSC bundles that are laid out once and only get new numbers, tick after tick.

python-osc lays out the bytes; filling in the floats afterwards takes microseconds where building
64 messages anew takes 2 ms of Python, which the tick's thread would have to wait for.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

MAX_DATAGRAM = 1400  # bytes; less than the 1472 that fit an Ethernet frame
BUNDLE_HEADER = 16  # bytes: "#bundle", time tag
# Address, leading texts or whole numbers, how many floats follow them.
Message = tuple[str, tuple[str | int, ...], int]


class OscBundles:
    """Messages in as few datagrams as the network's packet size allows, in order."""

    def __init__(self, messages: Sequence[Message]) -> None:
        from pythonosc.osc_bundle_builder import IMMEDIATELY, OscBundleBuilder

        self._bundles: list[tuple[bytearray, NDArray[np.float32], NDArray[np.intp]]] = []
        waiting, size, slots = OscBundleBuilder(IMMEDIATELY), BUNDLE_HEADER, list[int]()
        for message in messages:
            built = _build(message)
            if size + 4 + built.size > MAX_DATAGRAM:
                self._finish(waiting.build().dgram, slots)
                waiting, size, slots = OscBundleBuilder(IMMEDIATELY), BUNDLE_HEADER, list[int]()
            waiting.add_content(built)
            size += 4 + built.size
            slots += range(size // 4 - message[2], size // 4)
        self._finish(waiting.build().dgram, slots)

    def fill(
        self,
        values: NDArray[np.float32],  # [floats of all messages] in order
    ) -> list[bytes]:
        """The datagrams of one tick."""
        done, datagrams = 0, list[bytes]()
        for data, words, slots in self._bundles:
            words[slots] = values[done : done + len(slots)]
            done += len(slots)
            datagrams.append(bytes(data))
        assert done == len(values), f"{done} places for {len(values)} values"
        return datagrams

    def _finish(self, datagram: bytes, slots: list[int]) -> None:
        data = bytearray(datagram)
        self._bundles.append((data, np.frombuffer(data, ">f4"), np.array(slots, np.intp)))


def _build(message: Message):  # noqa: ANN202
    from pythonosc.osc_message_builder import OscMessageBuilder

    address, words, num_floats = message
    builder = OscMessageBuilder(address)
    for word in words:
        builder.add_arg(word, "s" if isinstance(word, str) else "i")
    for _ in range(num_floats):
        builder.add_arg(0.0, "f")
    return builder.build()
