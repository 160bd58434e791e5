"""Rows of the paper's tables: test segments, and the codes of each model for them.

Networks only; `app/eval/speech` turns codes into vertices and compares them. Segments have 100
frames (as in the paper); their audio features come from the whole clip, so that loudness has
settled. Shorter recordings (GRID: 3 s) are segments of their own, heard from the start.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from encoder.audio.alignment import stack_of
from encoder.audio.encoder import AudioEncoder
from encoder.capture.dataset import PACK_SAMPLES_PER_FRAME, SEGMENT_FRAMES, Clip, iter_pack
from encoder.denoiser.diffusion import Guidance, Schedule, conditioned_on, ddim_taus, sample_ddim
from encoder.denoiser.model import Denoiser
from encoder.eyes.gaze_graph import GazeGraph
from encoder.eyes.gaze_walk import synthesise
from encoder.types import Floats

TEACHER_STEPS = 40
BATCH = 16  # segments at once
LEVELS = 3  # frames of loudness that the energy-to-jaw baseline uses
Row = Callable[[int], Floats]  # seed of a sample -> codes [S, T, 256]


@dataclass(frozen=True, eq=False)
class Segment:
    """T = 100 frames of a test clip; fewer where the recordings are shorter."""

    clip: Clip
    frames: slice

    @property
    def audio(self) -> Floats:  # [800 T] at 24 kHz, -1..1
        start, stop = (PACK_SAMPLES_PER_FRAME * i for i in (self.frames.start, self.frames.stop))
        return np.asarray(self.clip.audio[start:stop]).astype(np.float32) / np.float32(32768)

    @property
    def rig(self) -> Floats:  # [T, 53]
        return self.clip.rig[self.frames].astype(np.float32)

    @property
    def gaze(self) -> Floats:  # [T, 6]
        return self.clip.gaze[self.frames].astype(np.float32).reshape(-1, 6)

    @property
    def phones(self) -> NDArray[np.int64]:
        return self.clip.phones[self.frames].astype(np.int64)


def group_of(clip: Clip) -> str:
    """Group of a test clip in the tables: freeform, sentence, its language, or the real speaker."""
    if clip.kind == "language":  # voices are named engine-language+variant
        return f"language {clip.voice.split('-', 1)[-1].split('+')[0]}"
    return clip.voice if clip.truth == "tracked" else clip.kind or clip.truth


def held_out_segments(pack: Path, count: int, seed: int = 0) -> dict[str, list[Segment]]:
    """Up to `count` random segments of each group of test clips."""
    groups: dict[str, list[Clip]] = {}
    for clip in iter_pack(pack, "test"):
        if clip.truth in ("rules", "tracked"):
            groups.setdefault(group_of(clip), []).append(clip)
    result = {}
    for name, clips in sorted(groups.items()):
        if all(clip.truth == "tracked" and clip.num_frames < SEGMENT_FRAMES for clip in clips):
            shortest = min(clip.num_frames for clip in clips)
            found = [Segment(clip, slice(0, shortest)) for clip in clips]
        else:
            if all(clip.num_frames < 2 * SEGMENT_FRAMES for clip in clips):
                clips = [joined(clips)]  # single short sentences that the capture made
            found = [Segment(clip, part) for clip in clips for part in clip.segments()]
        chosen = sorted(np.random.default_rng(seed).permutation(len(found))[:count])
        result[name] = [found[i] for i in chosen]
    return {name: segments for name, segments in result.items() if segments}


def joined(clips: Sequence[Clip]) -> Clip:
    """Clips joined end to end, with the labels of the first."""
    names = ("audio", "rig", "gaze", "phones", "tongue")
    arrays = {name: np.concatenate([getattr(clip, name) for clip in clips]) for name in names}
    return replace(clips[0], **arrays)


@torch.no_grad()
def features(
    segments: Sequence[Segment], encode: Callable[[Tensor], Tensor], ahead: int = 0
) -> Tensor:  # [S, T, A]
    """`encode`: sound [800 T] of a clip from its start -> features [T, A].

    ahead: frames of lookahead (silence after the end of the clip).
    """
    encoded: dict[int, Tensor] = {}
    for segment in segments:  # each clip once, up to its last segment
        clip = segment.clip
        if id(clip) not in encoded:
            last = max(s.frames.stop for s in segments if s.clip is clip) + ahead
            stop = last * PACK_SAMPLES_PER_FRAME
            heard = np.asarray(clip.audio[:stop], np.float32) / 32768
            sound = np.zeros(stop, np.float32)
            sound[: len(heard)] = heard
            encoded[id(clip)] = encode(torch.tensor(sound))
    return torch.stack(
        [encoded[id(s.clip)][s.frames.start + ahead : s.frames.stop + ahead] for s in segments]
    )


def whole(encoder: AudioEncoder) -> Callable[[Tensor], Tensor]:
    """For `features`: runs the encoder over a clip in one piece."""
    stack = stack_of(encoder.config)
    return lambda sound: stack(encoder(sound[None, :, None]))[0]


def true_gaze(segments: Sequence[Segment]) -> Tensor:  # [S, T, 6]
    return torch.tensor(np.stack([segment.gaze for segment in segments]))


def synthesised_gaze(count: int, frames: int, seed: int) -> Tensor:  # [S, T, 6]
    """Gaze as the live path synthesises it, a new walk for each segment."""
    graph = GazeGraph.load()
    rows = [synthesise(graph, frames, 1000 * seed + index) for index in range(count)]
    return torch.from_numpy(np.stack(rows)).reshape(count, frames, 6)


def noise(shape: Sequence[int], seed: int) -> Tensor:
    return torch.tensor(np.random.default_rng(seed).standard_normal(shape, dtype=np.float32))


def _codes(model: Denoiser, x0: Tensor) -> Floats:
    return model.unstandardise(x0).numpy()


@torch.no_grad()
def teacher_row(model: Denoiser, audio: Tensor, gaze: Tensor, guidance: Guidance) -> Row:
    """A row of 40 DDIM steps, with the guidance that the student was distilled from."""
    schedule = Schedule(model.config.num_steps)
    taus = ddim_taus(schedule.num_steps, TEACHER_STEPS)
    parts = list(zip(audio.split(BATCH), gaze.split(BATCH), strict=True))

    @torch.no_grad()
    def row(seed: int) -> Floats:
        rows = []
        for index, (a, g) in enumerate(parts):
            start = noise((*a.shape[:2], model.config.expression_dim), 1000 * seed + index)
            given = conditioned_on(model, a, g)
            x0 = sample_ddim(given, start, taus, schedule=schedule, guidance=guidance)
            rows.append(_codes(model, x0))
        return np.concatenate(rows)

    return row


def student_row(model: Denoiser, audio: Tensor, gaze: Tensor | None) -> Row:
    """A row of one step at tau = N over the whole segment; gaze None: synthesised."""

    @torch.no_grad()
    def row(seed: int) -> Floats:
        shown = synthesised_gaze(len(audio), audio.shape[1], seed) if gaze is None else gaze
        x = noise((*audio.shape[:2], model.config.expression_dim), seed)
        tau = torch.full((len(x),), model.config.num_steps)
        return _codes(model, model(x, tau, audio, shown))

    return row


def without_outpainting_row(model: Denoiser, audio: Tensor, gaze: Tensor | None) -> Row:
    """A row made frame by frame, with new noise for the whole past each time: no outpainting."""

    @torch.no_grad()
    def row(seed: int) -> Floats:
        shown = synthesised_gaze(len(audio), audio.shape[1], seed) if gaze is None else gaze
        tau = torch.full((len(audio),), model.config.num_steps)
        frames = []
        for t in range(audio.shape[1]):
            # chance moves the newest frame through its attention window; older reach is tiny
            first = max(0, t - 2 * model.config.window)
            past = slice(first, t + 1)
            x = noise(
                (len(audio), t + 1 - first, model.config.expression_dim), 10_000 * (seed + 1) + t
            )
            frames.append(model(x, tau, audio[:, past], shown[:, past])[:, -1])
        return _codes(model, torch.stack(frames, 1))

    return row


def loudness(audio: Floats) -> Floats:  # [800 T] -> [T, LEVELS]
    """Level of each frame and of those before it, in units of 20 dB."""
    power = (audio.reshape(-1, PACK_SAMPLES_PER_FRAME) ** 2).mean(1)
    level = (np.log10(power + 1e-7) / 2 + 2).astype(np.float32)
    earlier = [np.concatenate([np.repeat(level[:1], k), level]) for k in range(LEVELS)]
    return np.stack([row[: len(level)] for row in earlier], 1)


def fit_energy_to_jaw(pack: Path, jaw: int, limit: int = 400) -> Floats:  # [2 * LEVELS + 1]
    """Least-squares fit of the jaw to loudness and its square, over training clips."""
    rows, targets = [], []
    for clip in iter_pack(pack, "train"):
        if clip.truth not in ("rules", "tracked") or clip.num_frames < SEGMENT_FRAMES:
            continue
        segment = Segment(clip, slice(0, SEGMENT_FRAMES))
        rows.append(_energy_inputs(segment.audio))
        targets.append(segment.rig[:, jaw])
        if len(rows) >= limit:
            break
    x, y = np.concatenate(rows), np.concatenate(targets)
    fit = np.linalg.solve(x.T @ x + 1e-3 * np.eye(x.shape[1]), x.T @ y)
    return np.asarray(fit, np.float32)


def _energy_inputs(audio: Floats) -> Floats:
    level = loudness(audio)
    return np.concatenate([level, level**2, np.ones_like(level[:, :1])], 1)


def energy_to_jaw_rig(segments: Sequence[Segment], fit: Floats, jaw: int) -> Floats:
    """Rigs [S, T, 53] of the causal baseline: only the jaw moves, with loudness."""
    rig = np.stack([np.zeros_like(segment.rig) for segment in segments])
    for index, segment in enumerate(segments):
        rig[index, :, jaw] = np.clip(_energy_inputs(segment.audio) @ fit, 0, 1)
    return rig
