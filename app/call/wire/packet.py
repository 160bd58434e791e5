"""A tick as it travels: 55 numbers of the code, gaze, head and breath in 91 bytes.

A message holds the newest tick in full and up to two before it as differences of about 45 bytes, so
that one or two lost packets lose nothing. Numbers are whole: no bits of them decode to NaN.
"""

import hashlib
import math
import struct
from collections.abc import Container, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from app.call.wire import bits

Floats = NDArray[np.float32]
Ints = NDArray[np.int64]

VERSION = 1
RIG_DIM = 55  # 53 shapes and 2 of the tongue; the rest of the code is not sent
REACH_MIN = 30.0  # of a coordinate, in units of the code
OVERSHOOT = 1.25  # a coordinate reaches a quarter beyond every full shape
TICKS = 3  # in a message
MAX_MESSAGE = 400  # bytes
HEADER = struct.Struct("<BBHIi")  # version, ticks, basis, index of the newest, offset in samples

CODE_BITS, GAZE_BITS, SHIFT_BITS, TURN_BITS, BREATH_BITS = 11, 10, 12, 11, 5
CODE_MAX = 2 ** (CODE_BITS - 1) - 1
GAZE_STEP = np.radians(100) / 2**GAZE_BITS  # yaw and pitch reach +-50 degrees
SHIFT_STEP_MM = 0.5  # the head moves within +-1 m
BREATH_MAX = 2**BREATH_BITS - 1
TURN_MAX = 2 ** (TURN_BITS - 1) - 1  # of the three smallest numbers of a quaternion: +-sqrt(1/2)
WIDTHS = np.array(
    [CODE_BITS] * RIG_DIM + [GAZE_BITS] * 4 + [SHIFT_BITS] * 3 + [2, *[TURN_BITS] * 3, BREATH_BITS],
    np.int64,
)  # [F] bits of each field
TICK_BYTES = -(-int(WIDTHS.sum()) // 8)
_SIGN = 1 << WIDTHS - 1  # added, so that all are >= 0
_SIGN[[-5, -1]] = 0  # which number of the quaternion was left out; breath
_MOST = np.where(_SIGN > 0, _SIGN, 1 << WIDTHS) - 1.0
_LEAST = np.where(_SIGN > 0, -_MOST, 0.0)


class MalformedError(ValueError):
    """A malformed packet; it is counted and dropped."""


@dataclass(frozen=True, eq=False)
class Tick:
    """What a partner's face does at the end of frame `index`."""

    index: int
    expression: Floats  # [256]
    gaze: Floats  # [2, 3] unit, left eye first
    head_mm: Floats = field(default_factory=lambda: np.zeros(3, np.float32))
    head_wxyz: Floats = field(default_factory=lambda: np.array([1, 0, 0, 0], np.float32))
    breath: float = 0.0  # 0..1, lifts the chest


@dataclass(frozen=True, eq=False)
class Basis:
    """Which coordinates of a code travel, and how far each reaches. Both ends need the same."""

    rows: Floats  # [55, 256] orthonormal
    reach: Floats  # [55]

    @property
    def number(self) -> int:
        """16 bits that name this basis on the wire."""
        data = self.rows.astype("<f4").tobytes() + self.reach.astype("<f4").tobytes()
        return int.from_bytes(hashlib.sha256(data).digest()[:2], "little")

    @property
    def steps(self) -> NDArray[np.float64]:  # [55]
        return self.reach.astype(np.float64) / CODE_MAX


def basis_of(frame: Floats, to_code: Floats) -> Basis:
    """The basis of a decoder's coding: its `frame` [256, 256] and `to_code` [55, 256]."""
    full = np.abs(to_code.astype(np.float64) @ frame[:RIG_DIM].T.astype(np.float64)).max(0)
    reach = np.maximum(OVERSHOOT * full, REACH_MIN)
    return Basis(frame[:RIG_DIM].astype(np.float32), reach.astype(np.float32))


class Packer:
    """Ticks to bytes and back, in one basis."""

    def __init__(self, basis: Basis) -> None:
        self.number = basis.number
        self._rows = basis.rows.astype(np.float64)
        self._steps = basis.steps

    def fields(self, tick: Tick) -> Ints:
        """[F] whole numbers. Raises MalformedError for NaN, infinity or a quaternion of zeros."""
        given = np.concatenate(
            [tick.expression, tick.gaze.ravel(), tick.head_mm, tick.head_wxyz, [tick.breath]],
            dtype=np.float64,
        )
        if not np.isfinite(given).all() or not tick.head_wxyz.any():
            raise MalformedError(f"tick {tick.index}: expected finite numbers and a rotation")
        code = self._rows @ tick.expression.astype(np.float64) / self._steps
        gaze = [
            angle / GAZE_STEP
            for x, y, z in tick.gaze.tolist()
            for angle in (math.atan2(x, z), math.asin(min(max(y, -1), 1)))
        ]
        left_out, turn = _smallest_three(tick.head_wxyz.tolist())
        breath = min(max(tick.breath, 0), 1) * BREATH_MAX
        rest = [*gaze, *(tick.head_mm / SHIFT_STEP_MM).tolist(), left_out, *turn, breath]
        values = np.rint(np.concatenate([code, rest]))
        return np.minimum(np.maximum(values, _LEAST), _MOST).astype(np.int64) + _SIGN

    def message(self, ticks: Sequence[Ints], newest: int, offset: int) -> bytes:
        """`ticks` newest first, of the indices newest, newest - 1, ...; `offset` in samples: tick i
        ends at sample 1600 (i + 1) + offset of the voice."""
        parts = [bits.full(ticks[0], WIDTHS)]
        parts += [bits.difference(older, later) for later, older in pairwise(ticks)]
        body = np.packbits(np.concatenate(parts)).tobytes()
        return HEADER.pack(VERSION, len(ticks), self.number, newest, offset) + body

    def open(self, data: bytes, known: Container[int] = ()) -> tuple[list[Tick], int]:
        """The ticks of a message that are not `known`, newest first, and the offset of all;
        MalformedError for what is not one."""
        if not HEADER.size < len(data) <= MAX_MESSAGE:
            size = f"{HEADER.size} to {MAX_MESSAGE}"
            raise MalformedError(f"codes: expected {size} bytes, got {len(data)}")
        version, count, number, newest, offset = HEADER.unpack_from(data)
        if version != VERSION or number != self.number:
            got = f"version {version}, basis {number:04x}"
            raise MalformedError(
                f"codes: expected version {VERSION}, basis {self.number:04x}, got {got}"
            )
        if not 1 <= count <= min(TICKS, newest + 1):
            raise MalformedError(f"codes: expected 1 to {TICKS} ticks, got {count}")
        try:
            reader = bits.Reader(data[HEADER.size :])
            rows = [reader.full(WIDTHS)]
            if newest - 1 not in known or newest - 2 not in known:
                for _ in range(count - 1):
                    rows.append(reader.difference(rows[-1], WIDTHS))
                reader.end()
        except bits.BitsError as error:
            raise MalformedError(f"codes: {error}") from None
        new = [(newest - k, row) for k, row in enumerate(rows) if newest - k not in known]
        return [self._tick(row - _SIGN, index) for index, row in new], offset

    def _tick(self, values: Ints, index: int) -> Tick:
        code, rest = values[:RIG_DIM] * self._steps, values[RIG_DIM:]
        yaw, pitch = (rest[:4] * GAZE_STEP).reshape(2, 2).T
        gaze = [np.cos(pitch) * np.sin(yaw), np.sin(pitch), np.cos(pitch) * np.cos(yaw)]
        return Tick(
            index=index,
            expression=(code @ self._rows).astype(np.float32),
            gaze=np.stack(gaze, 1).astype(np.float32),
            head_mm=(rest[4:7] * SHIFT_STEP_MM).astype(np.float32),
            head_wxyz=_whole(int(rest[7]), rest[8:11]),
            breath=float(rest[11]) / BREATH_MAX,
        )


def _smallest_three(wxyz: Sequence[float]) -> tuple[int, list[float]]:
    """Index of the largest number, and the other three in steps."""
    left_out = max(range(4), key=lambda i: abs(wxyz[i]))
    scale = math.copysign(math.sqrt(2) * TURN_MAX, wxyz[left_out]) / math.hypot(*wxyz)
    return left_out, [value * scale for i, value in enumerate(wxyz) if i != left_out]


def _whole(left_out: int, turn: NDArray[np.int64]) -> Floats:
    rest = turn / (np.sqrt(2) * TURN_MAX)
    square = 1 - float(rest @ rest)
    if square < 0.2:  # of a unit quaternion the largest number's square is at least 1/4
        raise MalformedError("codes: expected a rotation, got no unit quaternion")
    wxyz = np.empty(4, np.float32)
    wxyz[np.arange(4) != left_out], wxyz[left_out] = rest, np.sqrt(square)
    return wxyz
