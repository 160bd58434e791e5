"""Gaussians as bytes for the network: 16 bytes each, and after the first message movers only.

    base:  the head at rest, once to a page     tick:  what differs from the base, 30 times a second

The head rests in both; a tick says how the neck moves it, and the receiver turns it in its own
light. No tick depends on another one, so any tick may be dropped. A Gaussian is four words:

    word 0:  x 14 bits | y 14 | turn c, low 4 bits
    word 1:  z 14 bits | turn a 10 | turn b, low 8 bits
    word 2:  log2 of the three scales, 8 bits each | turn b, high 2 bits | turn c, high 6 bits
    word 3:  red, green, blue, opacity, 8 bits each

Position and scales are shares of the ranges in the base; a, b, c are the turn's modified Rodrigues
parameters xyz / (1 + w), -1..1. Colours are without what is mirrored: for that the base ends with
the light, and four weights and a roughness, a byte each, for the first Gaussians (render/splats/
shine.py). These stay as they are at rest: a face that moves changes them by less than a byte of
colour. All little-endian.
"""

import struct
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.web import packing
from app.web.packing import POSITION_MAX, SCALE_MAX, TURN_MAX
from render.lighting import FILM, TOWARDS
from render.splats.shine import SOFT
from render.types import Gaussians, Shine
from sensors.rotation import Vector

BASE, TICK = 1, 2  # first byte of a message
HEAD = struct.Struct("<BxxxI")  # kind, number of Gaussians
# Low corner mm, step mm, lowest log2 of a scale, step; between the eyes, from the mean face's, mm.
RANGES = struct.Struct("<9f")
STAMP = struct.Struct("<qqII")  # frame, t_ns, number of movers, bytes of the neck that follow
# Number of Gaussians that mirror; of each lamp where it is and its width [4, 4], its light [4, 3];
# the film's curve [5].
LIGHT = struct.Struct("<I33f")
WEIGHT_MAX = 2.0  # of mirrored light, in a byte
STATIONS = 9  # of a neck, see render/decoder/neck.py: moves [9, 3, 4]; none: the head rests
STILL = np.tile(np.eye(3, 4, dtype=np.float32), (STATIONS, 1, 1))
MARGIN_MM = 40.0  # how far a Gaussian may leave the box of the head at rest
MARGIN_SCALE = 1.0  # log2: how much thinner or wider than any at rest

Words = NDArray[np.uint32]


@dataclass(frozen=True)
class Ranges:
    """What the bits mean."""

    low_mm: NDArray[np.float32]  # [3]
    step_mm: float
    low_scale: float  # log2 of mm
    step_scale: float
    eyes_mm: Vector = (0.0, 0.0, 0.0)  # see render/decoder/neck.py: where the neck is

    @classmethod
    def around(cls, rest: Gaussians, eyes_mm: Vector = (0.0, 0.0, 0.0)) -> "Ranges":
        low, high = rest.means.min(0) - MARGIN_MM, rest.means.max(0) + MARGIN_MM
        logs = np.log2(np.maximum(rest.scales, 1e-4))
        thin, wide = float(logs.min()) - MARGIN_SCALE, float(logs.max()) + MARGIN_SCALE
        step = float((high - low).max()) / POSITION_MAX
        return cls(low, step, thin, (wide - thin) / SCALE_MAX, eyes_mm)


def pack(gaussians: Gaussians, ranges: Ranges) -> Words:  # [N, 4]
    """Four words for every Gaussian."""
    words = np.empty((len(gaussians), 4), np.uint32)
    packing.pack_words(
        *(gaussians.means, gaussians.quats, gaussians.scales),
        *(gaussians.opacities, gaussians.colors, ranges.low_mm, np.float32(1 / ranges.step_mm)),
        *(np.float32(ranges.low_scale), np.float32(1 / ranges.step_scale), words),
    )
    return words


def pack_shine(shine: Shine | None) -> bytes:
    """The light, and what mirrors it."""
    if shine is None:
        return LIGHT.pack(0, *np.zeros(33))
    lamps = np.concatenate([TOWARDS, SOFT[:, None]], 1)
    head = LIGHT.pack(len(shine.weights), *lamps.flat, *shine.lamps.flat, *FILM)
    weights = np.rint(np.clip(shine.weights / WEIGHT_MAX, 0, 1) * 255).astype(np.uint8)
    return head + weights.tobytes() + np.rint(shine.roughness * 255).astype(np.uint8).tobytes()


def unpack_shine(message: bytes, start: int) -> Shine | None:
    count, *light = LIGHT.unpack_from(message, start)
    if not count:
        return None
    levels = np.frombuffer(message, np.uint8, 5 * count, start + LIGHT.size).astype(np.float32)
    return Shine(
        weights=levels[: 4 * count].reshape(-1, 4) * np.float32(WEIGHT_MAX / 255),
        roughness=levels[4 * count :] / np.float32(255),
        lamps=np.array(light[16:28], np.float32).reshape(4, 3),
    )


def base_message(gaussians: Gaussians, ranges: Ranges) -> bytes:
    """The head at rest, with the ranges that all ticks share."""
    head = HEAD.pack(BASE, len(gaussians))
    head += RANGES.pack(
        *(*ranges.low_mm, ranges.step_mm, ranges.low_scale, ranges.step_scale, *ranges.eyes_mm)
    )
    return head + pack(gaussians, ranges).tobytes() + pack_shine(gaussians.shine)


def tick_message(
    words: Words, base: Words, frame: int, t_ns: int, neck: NDArray[np.float32] = STILL
) -> bytes:
    """How the neck moves [STATIONS, 3, 4]; what differs from the base: which Gaussians, one bit
    each, then their words."""
    bits = np.empty(4 * -(-len(words) // 32), np.uint8)
    movers = np.empty_like(words)
    count = packing.find_movers(words, base, bits, movers)
    head = HEAD.pack(TICK, len(words)) + STAMP.pack(
        frame, t_ns, count, 0 if neck is STILL else STILL.nbytes
    )
    if neck is not STILL:
        head += neck.astype("<f4").tobytes()
    return head + bits.tobytes() + movers[:count].tobytes()


class CloudReader:
    """Messages back to Gaussians; what the page does in JavaScript, for Python receivers."""

    def __init__(self) -> None:
        self.gaussians: Gaussians | None = None
        self.frame, self.t_ns = -1, 0
        self.neck = STILL  # by which a receiver turns the head; `gaussians` are at rest

    def read(self, message: bytes) -> None:
        kind, count = HEAD.unpack_from(message)
        if kind == BASE:
            values = RANGES.unpack_from(message, HEAD.size)
            low, eyes_mm = np.array(values[:3], np.float32), (values[6], values[7], values[8])
            self._ranges = Ranges(low, values[3], values[4], values[5], eyes_mm)
            start = HEAD.size + RANGES.size
            words = np.frombuffer(message, "<u4", 4 * count, start)
            self._base = words.reshape(count, 4).astype(np.uint32)
            self._shine = unpack_shine(message, start + self._base.nbytes)
            words = self._base
        else:
            self.frame, self.t_ns, moved, turned = STAMP.unpack_from(message, HEAD.size)
            start, num_bytes = HEAD.size + STAMP.size, -(-count // 32) * 4
            self.neck = STILL
            if turned:
                neck = np.frombuffer(message, "<f4", STILL.size, start)
                self.neck, start = neck.reshape(STILL.shape), start + turned
            bits = np.frombuffer(message, np.uint8, num_bytes, start)
            mask = np.unpackbits(bits, bitorder="little", count=count).astype(bool)
            words = self._base.copy()
            words[mask] = np.frombuffer(message, "<u4", 4 * moved, start + num_bytes).reshape(-1, 4)
        self.gaussians = self._unpack(words)

    def _unpack(self, words: Words) -> Gaussians:
        ranges, (one, two, three, four) = self._ranges, words.T
        at = np.stack([one & POSITION_MAX, one >> 14 & POSITION_MAX, two & POSITION_MAX], 1)
        scales = np.stack([three & 255, three >> 8 & 255, three >> 16 & 255], 1)
        b, c = two >> 24 | (three >> 24 & 3) << 8, one >> 28 | three >> 26 << 4
        levels = np.stack([four >> shift & 255 for shift in (0, 8, 16, 24)], 1)
        shown = levels.astype(np.float32) / np.float32(255)
        return Gaussians(
            means=(ranges.low_mm + at * np.float32(ranges.step_mm)).astype(np.float32),
            quats=_unpack_turns(np.stack([two >> 14 & TURN_MAX, b, c], 1)),
            scales=np.exp2(ranges.low_scale + scales * ranges.step_scale).astype(np.float32),
            opacities=shown[:, 3],
            colors=shown[:, :3],
            shine=self._shine,
        )


def _unpack_turns(levels: Words) -> NDArray[np.float32]:  # [N, 3] -> [N, 4] wxyz
    turns = levels * np.float32(2 / TURN_MAX) - 1
    square = (turns * turns).sum(1, keepdims=True)
    return (np.concatenate([1 - square, 2 * turns], 1) / (1 + square)).astype(np.float32)
