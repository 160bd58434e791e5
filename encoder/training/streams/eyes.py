"""Training streams with eye features e, for the stage "multimodal".

e is synthesised from the streams' gaze and rig by the eye encoder's own map, with its scatter
between subjects and from frame to frame, and with cameras that get lost as EyeTracker handles it.
"""

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from encoder.capture.motion.channels import RIG_INDEX
from encoder.eyes.encoder import MIRROR
from encoder.eyes.format import FEATURES, RIG
from encoder.eyes.network import EyeNet
from encoder.eyes.tracker import FADE_FRAMES, HOLD_FRAMES
from encoder.training.geometry import TrainingFace
from encoder.training.streams.streams import AHEAD, GAZE_SCALE, REST_WEIGHT, Streams

RIG_COLUMNS = tuple(tuple(RIG_INDEX[f"{name}_{side}"] for name in RIG) for side in "LR")
BLINK_WEIGHT = 4.0  # a blink is 8 frames of 100; twice the weight shuts no lid further (measured)


class Batch(NamedTuple):
    """Data of one training step."""

    codes: Tensor  # [B, T, 256] truth
    audio: Tensor  # [B, T, A]
    scaled_gaze: Tensor  # [B, T, 6], as the gaze model was trained
    weight: Tensor  # [B, T]
    e: Tensor  # [B, T, 160]


class EyeStreams:
    """Streams with the upper face's rig, from which e is synthesised for every batch."""

    def __init__(self, path: Path, face: TrainingFace, net: EyeNet, lost: float) -> None:
        plain = Streams.load(path, face)
        with np.load(path, allow_pickle=False) as data:
            rig = data["rig"][..., np.array(RIG_COLUMNS).ravel()]  # [S, T, 14]
        # beside the sound, so that one draw cuts the same windows out of everything
        self.streams = replace(plain, features=np.concatenate([plain.features, rig], -1))
        self.audio_dim, self.net, self.lost = plain.features.shape[-1], net.eval(), lost

    def draw(self, batch: int, frames: int, rng: np.random.Generator) -> Batch:
        codes, audio, scaled, _ = self.streams.draw(batch, frames, rng)
        audio, rig = audio.split([self.audio_dim, 2 * len(RIG)], -1)
        rig = rig.reshape(batch, frames, 2, len(RIG))
        gaze = (scaled / GAZE_SCALE + torch.tensor(AHEAD)).reshape(batch, frames, 2, 3)
        weight = 1 + BLINK_WEIGHT * (rig[..., 0].amax(-1) > 0.3)
        e = synthesised(self.net, gaze, rig, self.lost, rng)
        return Batch(codes, audio.clone(), scaled, weight, e)

    def silence(self) -> Tensor | None:
        """Audio features [A] of a mouth at rest."""
        resting = self.streams.features[self.streams.weight == REST_WEIGHT]
        if len(resting) == 0:
            return None
        middle = np.median(resting[:20_000, : self.audio_dim].astype(np.float32), 0)
        return torch.from_numpy(middle)


@torch.no_grad()
def synthesised(
    net: EyeNet,
    gaze: Tensor,  # [B, T, 2, 3] unit vectors
    rig: Tensor,  # [B, T, 2, 7]
    lost: float,
    rng: np.random.Generator,
) -> Tensor:  # [B, T, 160]
    """e as the eye encoder and the tracker would produce it."""
    batch, frames = gaze.shape[:2]
    mirror = torch.from_numpy(MIRROR)
    left_like = torch.cat([gaze[..., :1] * mirror, gaze[..., 1:2]], -1)
    noise = torch.randn(batch, frames, 2, FEATURES) @ net.frame_spread
    constant = torch.randn(batch, 1, 2, FEATURES) @ net.subject_spread
    own = (net.synthesise(left_like, rig) + constant + noise).clamp(-1, 1)
    plain = torch.zeros_like(rig)
    plain[..., 0] = rig[..., :1].mean(2)  # both lids alike, nothing known of the brows
    walked = net.synthesise(left_like, plain)
    across = left_like.flip(2) * torch.tensor([-1.0, 1.0])  # where the other eye looks
    there = torch.zeros_like(rig)
    there[..., 0] = rig.flip(2)[..., 0]
    borrowed = own.flip(2) + net.synthesise(across, there)
    borrowed = (borrowed - net.synthesise(left_like.flip(2), there)).clamp(-1, 1)
    rows = []
    for b in range(batch):
        gone = [_lost_frames(frames, lost, rng) for _ in (0, 1)]
        both = gone[0] & gone[1]
        eyes = []
        for eye in (0, 1):
            other = torch.where(both[:, None], walked[b, :, eye], borrowed[b, :, eye])
            eyes.append(_switched(own[b, :, eye], other, gone[eye]))
        rows.append(torch.stack(eyes, 1))
    return torch.stack(rows).flatten(2)


def _lost_frames(frames: int, chance: float, rng: np.random.Generator) -> Tensor:  # [T] bool
    """Frames without a camera: sometimes a run of them, sometimes all."""
    gone = torch.zeros(frames, dtype=torch.bool)
    if rng.random() < chance:
        start, end = np.sort(rng.integers(-frames // 2, frames + frames // 2, 2))
        gone[max(start, 0) : max(end, 0)] = True
    return gone


def _switched(own: Tensor, other: Tensor, gone: Tensor) -> Tensor:
    """An eye's own features [T, 80]; while lost, held for 200 ms, then faded to the other ones."""
    place, share = np.arange(len(own)), np.zeros(len(own), np.float32)
    now, held = float(gone[0]), 0
    for t, lost in enumerate(gone.tolist()):
        held = held + 1 if lost else 0
        if t and 0 < held <= HOLD_FRAMES and now < 1:
            place[t] = place[t - 1]
        else:
            now = min(max(float(lost), now - 1 / FADE_FRAMES), now + 1 / FADE_FRAMES)
        share[t] = now
    mine, theirs = own[place], other[place]
    return mine + torch.from_numpy(share)[:, None] * (theirs - mine)
