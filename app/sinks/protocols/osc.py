"""OSC bundles that are laid out once and only get new values, tick after tick.

python-osc lays out the bytes; filling in the values afterwards takes microseconds where building
64 messages anew takes 2 ms of Python, which the tick's thread would have to wait for. A bool is
its type tag alone, T or F, so that tag is what is filled in.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

MAX_DATAGRAM = 1400  # bytes; less than the 1472 that fit an Ethernet frame
BUNDLE_HEADER = 16  # bytes: "#bundle", time tag
TRUE, FALSE = np.uint8(ord("T")), np.uint8(ord("F"))
NO_BOOLS = np.zeros(0, np.bool_)


class Message(NamedTuple):
    """What stays of a message, and how many values follow that are filled in."""

    address: str
    words: tuple[str | int, ...] = ()
    num_floats: int = 0
    num_bools: int = 0  # after the floats


class _Bundle(NamedTuple):
    """One datagram, and where in it the values go."""

    data: bytearray
    floats: NDArray[np.float32]  # big-endian view of the data
    slots: NDArray[np.intp]  # into `floats`
    tags: NDArray[np.uint8]  # view of the data
    places: NDArray[np.intp]  # into `tags`, of the bools


class OscBundles:
    """Messages in as few datagrams as the network's packet size allows, in order."""

    def __init__(self, messages: Sequence[Message]) -> None:
        from pythonosc.osc_bundle_builder import IMMEDIATELY, OscBundleBuilder

        self._bundles: list[_Bundle] = []
        waiting, size = OscBundleBuilder(IMMEDIATELY), BUNDLE_HEADER
        slots, places = list[int](), list[int]()
        for message in messages:
            built = _build(message)
            if size + 4 + built.size > MAX_DATAGRAM:
                self._finish(waiting.build().dgram, slots, places)
                waiting, size = OscBundleBuilder(IMMEDIATELY), BUNDLE_HEADER
                slots, places = list[int](), list[int]()
            waiting.add_content(built)
            kinds = built.dgram.index(b",", len(message.address.encode()))
            tag = size + 4 + kinds + 1 + len(message.words) + message.num_floats
            places += range(tag, tag + message.num_bools)
            size += 4 + built.size
            slots += range(size // 4 - message.num_floats, size // 4)
        self._finish(waiting.build().dgram, slots, places)

    def fill(
        self,
        values: NDArray[np.float32],  # [floats of all messages] in order
        bools: NDArray[np.bool_] = NO_BOOLS,  # [bools of all messages] in order
    ) -> list[bytes]:
        """The datagrams of one tick."""
        done, told, datagrams = 0, 0, list[bytes]()
        marks = np.where(bools, TRUE, FALSE)
        for data, floats, slots, tags, places in self._bundles:
            floats[slots] = values[done : done + len(slots)]
            tags[places] = marks[told : told + len(places)]
            done, told = done + len(slots), told + len(places)
            datagrams.append(bytes(data))
        assert done == len(values), f"{done} places for {len(values)} values"
        assert told == len(bools), f"{told} places for {len(bools)} bools"
        return datagrams

    def _finish(self, datagram: bytes, slots: list[int], places: list[int]) -> None:
        data = bytearray(datagram)
        floats, tags = np.frombuffer(data, ">f4"), np.frombuffer(data, np.uint8)
        of_floats, of_bools = np.array(slots, np.intp), np.array(places, np.intp)
        self._bundles.append(_Bundle(data, floats, of_floats, tags, of_bools))


def _build(message: Message):  # noqa: ANN202
    from pythonosc.osc_message_builder import OscMessageBuilder

    builder = OscMessageBuilder(message.address)
    for word in message.words:
        builder.add_arg(word, "s" if isinstance(word, str) else "i")
    for _ in range(message.num_floats):
        builder.add_arg(0.0, "f")
    for _ in range(message.num_bools):
        builder.add_arg(False, "F")
    return builder.build()
