"""What programs, pages and partners send: OSC, head trackers, picks, poses, packets of a call."""

import json
import struct
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from app.bench.fuzz.fuzzer import Fuzzer

STEP_NS = 5_000_000  # between two datagrams


def osc(fuzzer: Fuzzer, folder: Path) -> Callable[[], None]:
    from pythonosc.osc_bundle_builder import IMMEDIATELY, OscBundleBuilder
    from pythonosc.osc_message_builder import OscMessageBuilder

    from app.drive.emotion_port import ADDRESS, words_in

    message = OscMessageBuilder(ADDRESS)
    for value in ("happy", 0.5, 1, True):
        message.add_arg(value)
    inner, outer = OscBundleBuilder(IMMEDIATELY), OscBundleBuilder(IMMEDIATELY)
    inner.add_content(message.build())
    outer.add_content(inner.build())
    outer.add_content(message.build())
    datagrams = [message.build().dgram, outer.build().dgram]

    def feed() -> None:
        words_in(fuzzer.mutate(datagrams[fuzzer.pick(2)]))

    return feed


def head(fuzzer: Fuzzer, folder: Path) -> Callable[[], None]:
    """VMC, VRChat's trackers and Live Link Face, up to the gate."""
    from sensors.head import livelink, vmc
    from sensors.head.gate import ReadingGate
    from sensors.standins.osc import bundle

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
    gate, arrival_ns = ReadingGate("fuzz", lambda line: None), 0

    def feed() -> None:
        nonlocal arrival_ns
        data, decode = sent[fuzzer.pick(len(sent))]
        for reading in decode(fuzzer.mutate(data)):
            arrival_ns += STEP_NS
            gate(reading, arrival_ns)

    return feed


def call(fuzzer: Fuzzer, folder: Path) -> Callable[[], None]:
    """Sealed packets, messages of codes, hellos and invites, as a partner may send them."""
    from app.call.wire import agreement, invite, packet, seal
    from sensors.types import InputError

    rows = np.eye(packet.RIG_DIM, 256, dtype=np.float32)
    packer = packet.Packer(packet.Basis(rows, np.full(packet.RIG_DIM, 30, np.float32)))
    forward = np.tile(np.array([0, 0, 1], np.float32), (2, 1))
    ticks = [packet.Tick(k, np.full(256, k, np.float32), forward) for k in range(3)]
    codes = packer.message([packer.fields(tick) for tick in ticks[::-1]], 2, 0)
    names = "0" * 32, "1" * 32
    rings = [seal.Keyring(bytes(seal.SECRET_BYTES), name) for name in names]
    hello = agreement.Hello(identity=names[0], name="ann", basis=packer.number, met=(names[1],))
    link = "livedrive://127.0.0.1:8000/#" + "A" * 22 + "." + "A" * 43
    openers: tuple[tuple[bytes, Callable[[bytes], object]], ...] = (
        (codes, packer.open),
        (hello.to_bytes(), agreement.read_hello),
        (json.dumps({"version": 1}).encode(), agreement.read_hello),
        (link.encode(), lambda data: invite.parse(data.decode("utf-8", "replace"))),
        (
            rings[0].seal("codes", codes),
            lambda data: rings[1].open(names[0], "codes", data),
        ),
    )

    def feed() -> None:
        data, opened = openers[fuzzer.pick(len(openers))]
        with suppress(packet.MalformedError, seal.SealError, InputError):
            opened(fuzzer.mutate(data))

    return feed


def page(fuzzer: Fuzzer, folder: Path) -> Callable[[], None]:
    """What a page sends up, and what answers as VRChat to `--send vrchat://auto`."""
    from app.sinks.protocols.oscquery import PARAMETERS, face_in
    from app.web.messages import CHUNK_HEAD, MESSAGE, Picks, PoseMessages, SoundMessages
    from sensors.files import parse_json

    picks, poses, sounds = Picks("ben", ["ada", "ben"]), PoseMessages(), SoundMessages()
    picks.emotions = ["happy", "sad"]
    asked = b'{"avatar": "ada", "emotion": "happy:0.5", "muted": true}'
    node: dict[str, Any] = {
        "FULL_PATH": f"{PARAMETERS}/FT/v2/JawOpen",
        "CONTENTS": {"x": {"FULL_PATH": f"{PARAMETERS}/FT/v2/JawOpen1", "CONTENTS": {}}},
    }
    chunk = CHUNK_HEAD.pack(480) + np.zeros(480, np.float32).tobytes()
    readers: tuple[tuple[bytes, Callable[[bytes], object]], ...] = (
        (asked, picks.read),
        (MESSAGE.pack(*range(9)), lambda data: poses.packet(data, 0)),
        (chunk, lambda data: (sounds.begin(), sounds.packet(data, 0))),
        (json.dumps(node).encode(), lambda data: face_in(parse_json(data))),
    )

    def feed() -> None:
        data, read = readers[fuzzer.pick(len(readers))]
        with suppress(ValueError):
            read(fuzzer.mutate(data))

    return feed
