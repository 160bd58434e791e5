"""Stage 1: train the compact audio encoder (paper section 4.3 uses wav2vec; none is public here).

Supervised: linear heads on the stacked features of a frame must tell the mouth's curves, the phone
and the clean spectrum of the present frame. Each kind of truth (rules, tracked, envelope) has its
own mouth head, since each moves its mouth in its own way; the heads are thrown away.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from encoder import checkpoint
from encoder.audio_encoder import PRESETS as ENCODERS
from encoder.audio_encoder import AudioEncoder, AudioEncoderConfig
from encoder.capture.channels import JAW_OPEN, MOUTH_CLOSE, SPEECH_COLUMNS
from encoder.capture.dataset import (
    PACK_RATE,
    PACK_SAMPLES_PER_FRAME,
    Clip,
    read_manifest,
    read_pack,
)
from encoder.capture.speech import PHONES
from encoder.training import loop
from encoder.training.augment import Crop, crop

HEADS = ("rules", "tracked", "envelope")
NUM_MELS = 40


@dataclass(frozen=True, kw_only=True)
class AudioConfig:
    pack: Path
    output: Path  # without suffix: .safetensors and .json are added
    state: Path  # the resumable state of the run
    encoder: AudioEncoderConfig = field(default_factory=lambda: ENCODERS["default"])
    steps: int = 850
    batch: int = 10
    frames: int = 60
    rate: float = 2e-3
    seed: int = 0
    resume: bool = False
    # share of the batch for each kind of truth
    shares: tuple[tuple[str, float], ...] = (
        ("rules", 0.45),
        ("tracked", 0.2),
        ("envelope", 0.25),
        ("rest", 0.1),
    )
    note: tuple[tuple[str, str], ...] = ()  # goes into the card: command, commit, ...


PRESETS: dict[str, dict[str, Any]] = {
    "debug": {"encoder": ENCODERS["debug"], "steps": 2, "batch": 2, "frames": 12},
    "default": {},
    "paper": {"steps": 100_000, "batch": 64, "frames": 100, "rate": 1e-3},
}


def mel_filters() -> Tensor:  # [513, 40], triangles from 80 Hz to 8 kHz
    mel = np.linspace(2595 * np.log10(1 + 80 / 700), 2595 * np.log10(1 + 8000 / 700), NUM_MELS + 2)
    edges = 700 * (10 ** (mel / 2595) - 1)
    hz = np.linspace(0, PACK_RATE / 2, 513)[:, None]
    up = (hz - edges[:-2]) / np.diff(edges)[:-1]
    down = (edges[2:] - hz) / np.diff(edges)[1:]
    return torch.tensor(np.clip(np.minimum(up, down), 0, None), dtype=torch.float32)


def log_mel(audio: Tensor, filters: Tensor) -> Tensor:
    """[B, 800 T] -> [B, T, 40] of the 43 ms before each frame's end, zero mean, unit spread."""
    padded = functional.pad(audio, (1024 - PACK_SAMPLES_PER_FRAME, 0))
    windows = padded.unfold(1, 1024, PACK_SAMPLES_PER_FRAME) * torch.hann_window(1024)
    power = torch.fft.rfft(windows).abs().square() @ filters
    level = (power + 1e-5).log()
    return (level - level.mean((1, 2), keepdim=True)) / 2.5


class Heads(nn.Module):
    """What the features of one frame [B, T, A] must tell by a linear map."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.norm = nn.LayerNorm(width)
        self.mouth = nn.ModuleDict({n: nn.Linear(width, len(SPEECH_COLUMNS)) for n in HEADS})
        self.phone = nn.Linear(width, len(PHONES))
        self.mel = nn.Linear(width, NUM_MELS)

    def forward(self, features: Tensor) -> dict[str, Tensor]:
        x = self.norm(features)
        result = {name: head(x) * 0.1 for name, head in self.mouth.items()}
        return result | {"phone": self.phone(x), "mel": self.mel(x)}


def stacked(encoder: AudioEncoder, audio: Tensor) -> Tensor:
    """[B, 800 T] at 24 kHz -> audio_features [B, T, 512]: the four features of each frame."""
    features = encoder(audio[..., None])
    count = PACK_SAMPLES_PER_FRAME // encoder.config.stride
    return features.reshape(len(audio), -1, count * encoder.config.width)


def draw_batch(
    groups: dict[str, list[Clip]], config: AudioConfig, rng: np.random.Generator
) -> tuple[list[Crop], list[str]]:
    names = [name for name, _ in config.shares if groups.get(name)]
    share = np.array([value for name, value in config.shares if name in names])
    truths = [str(t) for t in rng.choice(names, config.batch, p=share / share.sum())]
    clips = [groups[truth][rng.integers(len(groups[truth]))] for truth in truths]
    return [crop(clip, config.frames, rng) for clip in clips], truths


def _channel_weights() -> Tensor:
    """[27] squared-error weights: the jaw and the closing of the lips are seen most."""
    weights = torch.full((len(SPEECH_COLUMNS),), 1.0)
    weights[SPEECH_COLUMNS.index(JAW_OPEN)] = 4.0
    weights[SPEECH_COLUMNS.index(MOUTH_CLOSE)] = 6.0
    return weights


def losses(
    outputs: dict[str, Tensor], crops: list[Crop], truths: list[str], filters: Tensor
) -> dict[str, Tensor]:
    """Mouth by the head of each crop's truth (a resting mouth by all), phones, clean spectrum."""
    rig = torch.tensor(np.stack([c.rig for c in crops])[..., SPEECH_COLUMNS])
    weights, jaw = _channel_weights(), SPEECH_COLUMNS.index(JAW_OPEN)
    mouth = []
    for name in HEADS:
        use = torch.tensor([1.0 if t == name else 2.0 if t == "rest" else 0.0 for t in truths])
        channel = torch.zeros_like(weights) if name == "envelope" else weights.clone()
        channel[jaw] = weights[jaw]
        error = (outputs[name] - rig).square() * channel * use[:, None, None]
        slope = (outputs[name] - rig).diff(dim=1).square() * channel * use[:, None, None]
        mouth.append((error.sum() + slope.sum()) / (len(truths) * rig.shape[1]))
    mel = log_mel(torch.tensor(np.stack([c.clean for c in crops])), filters)
    phones = torch.tensor(np.stack([c.phones for c in crops]))
    phone = functional.cross_entropy(
        outputs["phone"].flatten(0, 1), phones.flatten(), ignore_index=-1, label_smoothing=0.05
    )
    result = {"mouth": 20 * torch.stack(mouth).sum(), "phone": phone}
    result["mel"] = functional.smooth_l1_loss(outputs["mel"], mel)
    result["total"] = result["mouth"] + 0.3 * result["phone"] + 0.5 * result["mel"]
    return result


def run(config: AudioConfig) -> dict[str, float]:
    """Train and write the encoder with its card; returns the smoothed losses."""
    torch.manual_seed(config.seed)
    groups: dict[str, list[Clip]] = {}
    for clip in read_pack(config.pack, "train"):
        groups.setdefault(clip.truth, []).append(clip)
    encoder = AudioEncoder(config.encoder)
    width = encoder.config.width * PACK_SAMPLES_PER_FRAME // encoder.config.stride
    heads, filters = Heads(width), mel_filters()
    modules = {"encoder": encoder, "heads": heads}
    encoder.train()

    def step_losses(step: int) -> dict[str, Tensor]:
        crops, truths = draw_batch(groups, config, np.random.default_rng([config.seed, step]))
        outputs = heads(stacked(encoder, torch.tensor(np.stack([c.audio for c in crops]))))
        return losses(outputs, crops, truths, filters)

    metrics = loop.train(
        "audio", modules, loop.adamw(modules, config.rate), step_losses, steps=config.steps,
        rate=config.rate, state_path=config.state, resume=config.resume,
    )  # fmt: skip
    write(config, encoder, heads, metrics)
    return metrics


def write(
    config: AudioConfig, encoder: AudioEncoder, heads: Heads, metrics: dict[str, float]
) -> None:
    """Encoder to `config.output`; its heads beside the state, for making labels of real voices."""
    card = {
        "kind": "audio",
        "config": asdict(config.encoder),
        "data": read_manifest(config.pack)["sources"],
        "truth": "mouth curves: made by rules, by a face tracker (GRID), or by loudness (jaw only)",
        "steps": config.steps,
        "seed": config.seed,
        "metrics": {key: round(value, 5) for key, value in metrics.items()},
        **dict(config.note),
    }
    checkpoint.save(config.output, loop.halved(encoder.state_dict()), card)
    torch.save(heads.state_dict(), config.state.with_suffix(".heads"))


def preset(name: str, **settings: Any) -> AudioConfig:
    return replace(AudioConfig(**settings), **PRESETS[name])


Outputs = Callable[[np.ndarray], dict[str, np.ndarray]]  # [800 T] at 24 kHz -> the heads' [T, n]


def load_heads(path: Path) -> Heads:
    """The heads that `run` left beside its state."""
    tensors = torch.load(path, weights_only=True)
    heads = Heads(tensors["norm.weight"].shape[0])
    heads.load_state_dict(tensors)
    return heads.eval()
