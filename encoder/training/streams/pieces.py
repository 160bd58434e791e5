"""Random pieces of spoken frames, with the mouths in them as numbers."""

import numpy as np
import torch
from torch import Tensor

from encoder.capture.speech.phones import PHONES
from encoder.training.mouth import Mouth
from encoder.training.streams.lip_width import APART_MM, levelled
from encoder.training.streams.spoken import REST, RULES, SpokenFrames

LEAST = 1e-3  # share of a phone, added to all
EARLY = 0.25  # of a frame by which lips are asked before the labels: in doubt they open late
PAUSE = 4  # frames from what a talker says, beyond which that one is not heard


class SpokenPieces:
    """Pieces of at most `length` frames.

    rules, rest: weights of rule-made motion and of sounds without a voice; real talkers have 1.
    """

    def __init__(
        self, frames: SpokenFrames, mouth: Mouth, *, batch: int, length: int, rules: float,
        rest: float,
    ) -> None:  # fmt: skip
        self.frames, self.mouth, self.batch, self.length = frames, mouth, batch, length
        codes = mouth.face.rig_to_code(frames.rig.astype(np.float32))
        truth = (codes @ mouth.read).astype(np.float32)
        self.own = frames.own.astype(np.float32) @ mouth.read
        ends = np.cumsum(frames.lengths)
        self._places = np.array([
            (first, min(length, int(end) - first))
            for end, count in zip(ends, frames.lengths, strict=True)
            for first in range(int(end - count), int(end), length)
        ])  # fmt: skip
        weight = voice_weights(frames.voice, rules, rest)
        chances = weight[self._places[:, 0]] * self._places[:, 1]
        self._chances = chances / chances.sum()
        apart = mouth.gap(torch.from_numpy(truth)).numpy() > APART_MM
        voiced = (frames.phones > 0) | ((frames.phones < 0) & apart)
        silent = (frames.voice == REST) | pauses(frames)
        self.voiced = np.where(silent, 0, np.where(voiced, 1, -1)).astype(np.int8)
        truth = levelled(truth, frames.voice, self.voiced == 1, mouth)
        self.truth = earlier(truth, frames.lengths)

    def draw(self, rng: np.random.Generator) -> tuple[Tensor, ...]:
        """heard [B, T, D], own and truth [B, T, MOUTH]; phones [B, T], voiced (1, 0 or -1: not
        known) and 1 where a piece has a frame."""
        chosen = self._places[rng.choice(len(self._places), self.batch, p=self._chances)]
        place = np.arange(self.length)
        there = place < chosen[:, 1:]
        rows = chosen[:, :1] + np.minimum(place, chosen[:, 1:] - 1)
        parts = (
            self.frames.heard[rows].astype(np.float32), self.own[rows], self.truth[rows],
            self.frames.phones[rows].astype(np.int64), self.voiced[rows].astype(np.float32),
            there.astype(np.float32),
        )  # fmt: skip
        return tuple(torch.from_numpy(part) for part in parts)


def earlier(truth: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    """Clips of these lengths, end to end [N, MOUTH] -> the same, EARLY of a frame before."""
    following = np.append(truth[1:], truth[-1:], axis=0)
    last = np.cumsum(lengths) - 1
    following[last] = truth[last]
    return (1 - EARLY) * truth + EARLY * following


def pauses(frames: SpokenFrames) -> np.ndarray:
    """[N] bool: where nothing is said by a talker whose phones are known, for PAUSE frames before
    and after; others may talk."""
    clips = np.repeat(np.arange(len(frames.lengths)), frames.lengths)
    near = np.zeros(len(clips), bool)
    for shift in range(-PAUSE, PAUSE + 1):
        near |= (np.roll(frames.phones, shift) > 0) & (np.roll(clips, shift) == clips)
    return (frames.phones == 0) & ~near


def voice_weights(voice: np.ndarray, rules: float, rest: float) -> np.ndarray:
    """Weights [N]: a talker gets the root of the number of frames; sum 1."""
    weight = np.zeros(len(voice))
    for name in set(voice.tolist()) - {RULES, REST}:
        weight[voice == name] = 1 / np.sqrt((voice == name).sum())
    weight /= max(weight.sum(), 1e-9)
    for name, share in ((RULES, rules), (REST, rest)):
        weight[voice == name] = share / max((voice == name).sum(), 1)
    return weight / weight.sum()


def phone_weights(phones: np.ndarray, balance: float) -> np.ndarray:
    """Weight [P + 1] of a frame by its phone, mean 1 over `phones` [N] that are known: its share to
    the power of -balance. Where the phone is not known, that of silence."""
    count = np.bincount(phones[phones >= 0], minlength=len(PHONES))
    share = count / max(count.sum(), 1)
    weight = (share + LEAST) ** -balance
    weight /= max((weight * share).sum(), 1e-9)
    return np.append(weight, weight[0]).astype(np.float32)
