"""What the audio encoder is asked in training: linear heads on its features, and their losses.

Also used by `streams`: the heads label the voices that nobody tracked.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from encoder import checkpoint
from encoder.capture.channels import JAW_OPEN, MOUTH_CLOSE, SPEECH_COLUMNS
from encoder.capture.dataset import PACK_RATE, PACK_SAMPLES_PER_FRAME
from encoder.capture.speech import PHONES
from encoder.training.augment import Crop

HEADS = ("rules", "tracked", "envelope")
NUM_MELS = 40


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
    windows = padded.unfold(1, 1024, PACK_SAMPLES_PER_FRAME) * torch.hann_window(
        1024, device=audio.device
    )
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


def _channel_weights() -> Tensor:
    """[27] squared-error weights: the jaw and the closing of the lips are seen most."""
    weights = torch.full((len(SPEECH_COLUMNS),), 1.0)
    weights[SPEECH_COLUMNS.index(JAW_OPEN)] = 4.0
    weights[SPEECH_COLUMNS.index(MOUTH_CLOSE)] = 6.0
    return weights


def _share(head: str, truth: str) -> float:
    """How much a crop of this truth teaches a mouth head: its own one, a resting mouth all."""
    if truth == "rest":
        return 2.0
    return float(head == {"emotional": "rules"}.get(truth, truth))


def losses(
    outputs: dict[str, Tensor], crops: list[Crop], truths: list[str], filters: Tensor
) -> dict[str, Tensor]:
    """Mouth by the head of each crop's truth (a resting mouth by all), phones, clean spectrum."""
    device = filters.device
    rig = torch.tensor(np.stack([c.rig for c in crops])[..., SPEECH_COLUMNS], device=device)
    weights, jaw = _channel_weights().to(device), SPEECH_COLUMNS.index(JAW_OPEN)
    mouth = []
    for name in HEADS:
        use = torch.tensor([_share(name, truth) for truth in truths], device=device)
        channel = torch.zeros_like(weights) if name == "envelope" else weights.clone()
        channel[jaw] = weights[jaw]
        error = (outputs[name] - rig).square() * channel * use[:, None, None]
        slope = (outputs[name] - rig).diff(dim=1).square() * channel * use[:, None, None]
        mouth.append((error.sum() + slope.sum()) / (len(truths) * rig.shape[1]))
    mel = log_mel(torch.tensor(np.stack([c.clean for c in crops]), device=device), filters)
    phones = torch.tensor(np.stack([c.phones for c in crops]), device=device)
    phone = functional.cross_entropy(
        outputs["phone"].flatten(0, 1), phones.flatten(), ignore_index=-1, label_smoothing=0.05
    )
    if not bool((phones >= 0).any()):
        phone = outputs["phone"].sum() * 0
    result = {"mouth": 20 * torch.stack(mouth).sum(), "phone": phone}
    result["mel"] = functional.smooth_l1_loss(outputs["mel"], mel)
    result["total"] = result["mouth"] + 0.6 * result["phone"] + 0.5 * result["mel"]
    return result


Outputs = Callable[[np.ndarray], dict[str, np.ndarray]]  # [800 T] at 24 kHz -> the heads' [T, n]


def load_heads(path: Path) -> Heads:
    tensors, card = checkpoint.load(path, "heads")
    heads = Heads(card["config"]["width"])
    heads.load_state_dict({name: tensor.float() for name, tensor in tensors.items()})
    return heads.eval()
