"""The peers: their published shapes, and what they must run for one new frame of a live face.

Where a paper leaves a choice, the one that is faster for the peer is taken: past frames are kept
and not made anew, at most four seconds of sound are heard, tokenizers of sound are free.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from app.bench.peers.parts import (
    RATE,
    Convolutions,
    SequenceDecoder,
    VectorQuantised,
    Wav2Vec2,
    encoder,
)

if TYPE_CHECKING:
    from torch import nn

VERTICES = 15_069  # numbers of VOCASET's 5023
SECONDS = 4.0


@dataclass(frozen=True)
class Stage:
    """A network, the shapes that it is given, and how often it runs for one frame."""

    build: Callable[[], "nn.Module"]
    inputs: tuple[tuple[int, ...], ...]
    times: int = 1


@dataclass(frozen=True)
class Peer:
    name: str
    stages: tuple[Stage, ...]
    waits_s: float  # for sound that it must have before it begins: its chunk or window
    schedule: str
    source: str


@dataclass(frozen=True)
class QuotedPeer:
    """One that is not run: what its makers state it hears beyond a frame."""

    name: str
    waits_s: float
    source: str


def _audio(frames: int, seconds: float = SECONDS) -> Stage:
    return Stage(lambda: Wav2Vec2(frames), ((1, int(seconds * RATE)),))


def _autoregressive(layers: int, dim: int, ff_dim: int) -> Stage:
    frames = int(SECONDS * 30)
    shapes = (1, frames, VERTICES), (1, frames, 768)
    return Stage(lambda: SequenceDecoder(layers, dim, ff_dim, 4, 768, VERTICES, VERTICES), shapes)


PEERS = (
    Peer(
        "FaceFormer",
        (_audio(120), _autoregressive(1, 64, 128)),
        0.0,
        "autoregressive; sound so far anew, one step",
        "Fan et al. 2022",
    ),
    Peer(
        "CodeTalker",
        (
            _audio(120),
            Stage(lambda: SequenceDecoder(6, 1024, 2048, 4, 768, VERTICES, 1024),
                  ((1, 120, VERTICES), (1, 120, 768))),
            Stage(lambda: VectorQuantised(256, 64, 16, VERTICES), ((1, 120, 1024),)),
        ),
        0.0,
        "autoregressive; sound so far anew, one step",
        "Xing et al. 2023",
    ),
    Peer(
        "Imitator",
        (_audio(120), _autoregressive(5, 64, 128)),
        0.0,
        "autoregressive; sound so far anew, one step",
        "Thambiraja et al. 2023",
    ),
    Peer(
        "TalkSHOW, face",
        (_audio(120), Stage(lambda: Convolutions(9, 768, 256, 103), ((1, 120, 768),))),
        0.0,
        "the whole window anew",
        "Yi et al. 2023",
    ),
    Peer(
        "LAM Audio2Expression",
        (_audio(64, 64 / 30), Stage(lambda: Convolutions(8, 832, 512, 52), ((1, 64, 832),))),
        1.0,
        "chunks of 1 s",
        "He et al. 2025",
    ),
    Peer(
        "Audio2Photoreal, face",
        (
            _audio(120),
            Stage(lambda: encoder(2, 512, 1024, 8), ((1, 400, 512),)),
            Stage(lambda: SequenceDecoder(4, 512, 1024, 4, 512, 512, 1014),
                  ((1, 120, 512), (1, 120, 512))),
            Stage(lambda: SequenceDecoder(8, 512, 1024, 8, 512, 256, 256),
                  ((2, 120, 256), (2, 402, 512)), 500),
        ),
        0.0,
        "500 DDIM steps, two passes each, over the window",
        "Ng et al. 2024",
    ),
    Peer(
        "DiffPoseTalk",
        (
            _audio(110, 110 / 25),
            Stage(lambda: SequenceDecoder(8, 512, 2048, 8, 768, 256, 256),
                  ((3, 110, 256), (3, 110, 768)), 500),
        ),
        4.0,
        "windows of 100 frames, 500 steps, three passes each",
        "Sun et al. 2024",
    ),
    Peer(
        "ARTalk",
        tuple(
            Stage(lambda: SequenceDecoder(12, 768, 3072, 12, 512, 768, 64),
                  ((2, 200 + n, 768), (2, 100, 512)))
            for n in (1, 6, 31, 81, 181)
        ),
        4.0,
        "windows of 4 s, five scales, two passes each",
        "Chu et al. 2025",
    ),
)  # fmt: skip

QUOTED = (
    QuotedPeer(
        "NVIDIA Audio2Face-3D, quoted",
        4160 / RATE,
        "NVIDIA/Audio2Face-3D-Training-Framework, docs/config_details.md: buffer_len 8320, "
        "buffer_ofs 4160 samples at 16 kHz, so a frame lies in the middle of what it hears",
    ),
)
