"""Messages between the loop and the call's process, see app.process.

loop:  settings at its start, sound of the microphone, ticks, changes of state
call:  the invite, lines to tell, what the loudspeaker plays (for the echo canceller), a report
"""

import json
import struct
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.call.wire.packet import Tick

SOUND, TICK, STATE, END = b"A", b"T", b"S", b"E"
INVITE, LINE, PLAYED, REPORT, ERROR = b"I", b"L", b"F", b"R", b"X"
SOUND_HEAD = struct.Struct("<qq")  # the device's count and the time of the first sample
TICK_ROW = np.dtype(
    [
        ("index", "<i8"),
        ("end_ns", "<i8"),
        ("expression", "<f4", (256,)),
        ("gaze", "<f4", (2, 3)),
        ("head_mm", "<f4", (3,)),
        ("head_wxyz", "<f4", (4,)),
        ("breath", "<f4"),
    ]
)


@dataclass(frozen=True, kw_only=True)
class CallSettings:
    name: str
    avatar: str
    invite: str = ""  # empty: this end opens the call
    room: str = ""  # name of a room to open; empty: a direct call
    server: str = ""  # ws://HOST:PORT or wss://HOST:PORT of the room's server
    server_key: str = ""
    listen: str = "0.0.0.0"
    port: int = 0
    address: str = ""  # that the invite names and media is offered at; empty: found out
    avatar_file: str = ""  # that is offered
    avatars: str = ""  # folder for those that come
    speaker: str | None = None  # name or part of it, or none
    accept: bool = False  # without asking
    tells: bool = False  # lines of who is muted or records, which no window shows
    ice_servers: tuple[str, ...] = ()


def pack_sound(first: int, t_ns: int, samples: NDArray[np.float32]) -> bytes:
    return SOUND + SOUND_HEAD.pack(first, t_ns) + samples.astype("<f4").tobytes()


def unpack_sound(packet: bytes) -> tuple[int, NDArray[np.float32], int]:
    """What Call.speak takes."""
    first, t_ns = SOUND_HEAD.unpack_from(packet, 1)
    return first, np.frombuffer(packet, "<f4", offset=1 + SOUND_HEAD.size), t_ns


def pack_tick(tick: Tick, end_ns: int) -> bytes:
    row = np.zeros((), TICK_ROW)
    row["index"], row["end_ns"] = tick.index, end_ns
    row["expression"], row["gaze"] = tick.expression, tick.gaze
    row["head_mm"], row["head_wxyz"] = tick.head_mm, tick.head_wxyz
    row["breath"] = tick.breath
    return TICK + row.tobytes()


def unpack_tick(packet: bytes) -> tuple[Tick, int]:
    row = np.frombuffer(packet, TICK_ROW, offset=1)[0]
    head = row["head_mm"], row["head_wxyz"], float(row["breath"])
    tick = Tick(int(row["index"]), row["expression"], row["gaze"], *head)
    return tick, int(row["end_ns"])


def pack_json(kind: bytes, value: object) -> bytes:
    return kind + json.dumps(value).encode()
