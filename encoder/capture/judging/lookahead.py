"""Comparison of rule-made with real motion by a small causal network.

Judges the capture stage: one network learns the jaw of real clips, one the jaw of rule-made clips.
Both must lose as little without lookahead, and each must understand the other's jaw.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from encoder.capture.dataset import PACK_RATE, PACK_SAMPLES_PER_FRAME, Clip
from encoder.capture.motion.channels import JAW_OPEN

LOOKAHEADS_MS = (0, 70, 150)
CLIP_FRAMES = 88
NUM_MELS = 40
HOP = 200  # samples: four spectra a frame
LAGS = range(-4, 5)  # further out the next syllable answers


class CausalNet(nn.Module):
    """Eight dilated causal convolutions over frames: [B, T, 160] -> jaw [B, T, lookaheads]."""

    def __init__(self, width: int = 64) -> None:
        super().__init__()
        self.inward = nn.Linear(NUM_MELS * PACK_SAMPLES_PER_FRAME // HOP, width)
        self.dilations = (1, 2, 4, 8, 1, 2, 4, 8)
        self.blocks = nn.ModuleList(nn.Conv1d(width, width, 3, dilation=d) for d in self.dilations)
        self.out = nn.Linear(width, len(LOOKAHEADS_MS))

    def forward(self, x: Tensor) -> Tensor:
        h = self.inward(x).transpose(1, 2)
        for dilation, block in zip(self.dilations, self.blocks, strict=True):
            h = h + functional.gelu(block(functional.pad(h, (2 * dilation, 0))))
        return self.out(h.transpose(1, 2))


@dataclass(frozen=True)
class JawData:
    """Clips of one kind of truth: features [N, T, 160] and jaw [N, T, lookaheads], float32."""

    features: np.ndarray
    jaw: np.ndarray

    def __len__(self) -> int:
        return len(self.jaw)


def mel_features(audio: np.ndarray) -> np.ndarray:
    """[800 T] at 24 kHz -> [T, 160] log spectra that end with the frame; loudness normalised."""
    size = 512
    hz = np.fft.rfftfreq(size, 1 / PACK_RATE)
    low, high = (2595 * np.log10(1 + f / 700) for f in (80, 7600))
    mel = np.linspace(low, high, NUM_MELS + 2)
    edges = 700 * (10 ** (mel / 2595) - 1)
    up = (hz[:, None] - edges[:-2]) / np.diff(edges)[:-1]
    down = (edges[2:] - hz[:, None]) / np.diff(edges)[1:]
    bank = np.clip(np.minimum(up, down), 0, None).astype(np.float32)
    padded = np.concatenate([np.zeros(size - HOP, np.float32), audio.astype(np.float32)])
    padded /= max(float(np.sqrt((padded**2).mean())), 1e-4)
    windows = np.lib.stride_tricks.sliding_window_view(padded, size)[::HOP] * np.hanning(size)
    power = np.abs(np.fft.rfft(windows.astype(np.float32))) ** 2 @ bank
    level = np.log(power + 1e-2) / 3
    frames = len(audio) // PACK_SAMPLES_PER_FRAME
    return level[: 4 * frames].reshape(frames, -1).astype(np.float32)


def source(clips: Sequence[Clip]) -> JawData:
    """Cut clips into pieces of CLIP_FRAMES; the jaw of a lookahead is the jaw so much earlier."""
    features, jaws = [], []
    for clip in clips:
        for start in range(0, clip.num_frames - CLIP_FRAMES + 1, CLIP_FRAMES):
            stop = start + CLIP_FRAMES
            hop = PACK_SAMPLES_PER_FRAME
            audio = np.asarray(clip.audio[start * hop : stop * hop], np.float32) / 32768
            if np.abs(audio).max() < 0.01:
                continue
            jaw = clip.rig[start:stop, JAW_OPEN].astype(np.float32)
            at = np.arange(CLIP_FRAMES)
            delayed = [np.interp(at - ms * 0.03, at, jaw) for ms in LOOKAHEADS_MS]
            features.append(mel_features(audio))
            jaws.append(np.stack(delayed, -1))
    return JawData(np.stack(features), np.stack(jaws).astype(np.float32))


def train(data: JawData, steps: int = 700, seed: int = 0) -> CausalNet:
    """Least squares, with random spectral tilt and gain: other microphones, other voices."""
    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    net = CausalNet()
    optimiser = torch.optim.AdamW(net.parameters(), 2e-3, weight_decay=1e-2)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, steps)
    scale = float(data.jaw.std())
    for _ in range(steps):
        rows = rng.integers(len(data), size=24)
        x = _vary(torch.from_numpy(data.features[rows]))
        error = (net(x) - torch.from_numpy(data.jaw[rows])) / scale
        loss = error[:, 10:].square().mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        schedule.step()
    return net.eval()


def _vary(x: Tensor) -> Tensor:
    """Shift each clip's mel axis by up to four bands (formants), bend it, change its level."""
    bands = x.unflatten(-1, (-1, NUM_MELS))
    place = torch.arange(NUM_MELS) + torch.randint(-4, 5, (len(x), 1))
    index = place.clamp(0, NUM_MELS - 1)[:, None, None].expand(bands.shape)
    bands = bands.gather(-1, index)
    ramp = torch.linspace(-1, 1, NUM_MELS)
    tilt = ramp * 0.5 * torch.randn(len(x), 1, 1, 1) + 0.3 * torch.randn(len(x), 1, 1, 1)
    wave = (
        0.3 * torch.randn(len(x), 1, 1, 1) * torch.sin(6 * ramp + 6 * torch.rand(len(x), 1, 1, 1))
    )
    return (bands + tilt + wave + 0.15 * torch.randn_like(bands)).flatten(2)


@torch.no_grad()
def predict(net: CausalNet, data: JawData) -> np.ndarray:
    """[N, T, lookaheads]"""
    return net(torch.from_numpy(data.features)).numpy()


def lookahead_scores(net: CausalNet, test: JawData) -> dict[str, float]:
    """R2 and r of the jaw at each lookahead over all test frames past the first third second."""
    guess, truth = predict(net, test)[:, 10:], test.jaw[:, 10:]
    scores = {}
    for k, ms in enumerate(LOOKAHEADS_MS):
        error, spread = guess[..., k] - truth[..., k], truth[..., k] - truth[..., k].mean()
        scores[f"r2_{ms}ms"] = 1 - float((error**2).sum() / (spread**2).sum())
        scores[f"r_{ms}ms"] = float(np.corrcoef(guess[..., k].ravel(), truth[..., k].ravel())[0, 1])
    return scores


def jaw_lag_frames(data: JawData) -> int:
    """How many frames the jaw comes after the sound's energy, by the mean correlation."""
    bands = data.features.reshape(*data.features.shape[:2], -1, NUM_MELS)
    energy = bands[..., 3:30].mean((-2, -1))
    inner = slice(8, CLIP_FRAMES - 8)
    totals = []
    for lag in LAGS:
        moved = np.roll(data.jaw[..., 0], -lag, 1)[:, inner]
        a, b = (v - v.mean(1, keepdims=True) for v in (energy[:, inner], moved))
        scale = np.sqrt((a**2).sum(1) * (b**2).sum(1)) + 1e-9
        totals.append(float(((a * b).sum(1) / scale).mean()))
    return LAGS[int(np.argmax(totals))]


def compare(real: tuple[JawData, JawData], made: tuple[JawData, JawData]) -> dict[str, float]:
    """Train on (train, test) of both kinds; the flat report that the statistics page prints."""
    report: dict[str, float] = {}
    nets = {name: train(pair[0]) for name, pair in (("real", real), ("made", made))}
    for name, pair in (("real", real), ("made", made)):
        scores = lookahead_scores(nets[name], pair[1])
        report |= {f"{name}_jaw_{key}": value for key, value in scores.items()}
        report[f"{name}_jaw_r2_kept"] = scores["r2_0ms"] / scores["r2_150ms"]
        report[f"{name}_jaw_lag_frames"] = float(jaw_lag_frames(pair[1]))
    report["real_predicts_made_r"] = lookahead_scores(nets["real"], made[1])["r_0ms"]
    report["made_predicts_real_r"] = lookahead_scores(nets["made"], real[1])["r_0ms"]
    return report
