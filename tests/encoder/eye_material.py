"""Small eye encoders and gaze graphs for the tests, and pictures of drawn eyes."""

from __future__ import annotations

import numpy as np
import torch

from encoder.eyes.encoder import EyeEncoder
from encoder.eyes.format import PRESETS
from encoder.eyes.gaze_graph import GazeGraph, build
from encoder.eyes.network import EyeNet


def net(preset: str = "debug") -> EyeNet:
    """Untrained, and without a default statistic that could hide an error."""
    torch.manual_seed(3)
    made = EyeNet(PRESETS[preset])
    for norm in made.norms:
        torch.nn.init.normal_(norm.running_mean, std=0.1)  # type: ignore[arg-type]
        torch.nn.init.uniform_(norm.running_var, 0.5, 2)  # type: ignore[arg-type]
        torch.nn.init.normal_(norm.bias, std=0.2)  # type: ignore[arg-type]
    with torch.no_grad():
        made.heads.bias[2:4] = torch.tensor([1.5, 6.0])  # every picture is an open eye
        made.meter.heads.bias[:2] = torch.tensor([6.0, 1.5])
        made.meter.heads.bias[4] = -9.0  # of whose gaze there is no doubt
        made.finder.heads.weight.zero_()  # and pictures are taken as they are
        made.finder.heads.bias.copy_(torch.tensor([20.0, 0, 0, 0, 1, 0]))
        made.heads.weight[:2] *= 3
        made.pair[2].weight.normal_(std=0.1)  # type: ignore[operator]
        made.relative.normal_(std=0.05)
    return made.eval()


def encoder(preset: str = "debug") -> EyeEncoder:
    made = net(preset)
    return EyeEncoder(made.config, {k: v.numpy() for k, v in made.state_dict().items()})


def looks(frames: int, seed: int = 0) -> np.ndarray:  # [T, 2, 3]
    """Fixations of a second, and jumps of 4 frames between them."""
    rng = np.random.default_rng(seed)
    places = rng.normal(0, 0.12, (frames // 30 + 2, 2))
    progress = np.clip((np.arange(frames) % 30 + 1) / 4, 0, 1)[:, None]
    which = np.arange(frames) // 30
    xy = places[which] + progress * (places[which + 1] - places[which])
    both = np.stack([xy - [0.03, 0], xy + [0.03, 0]], 1)
    gaze = np.concatenate([both, np.sqrt(1 - (both**2).sum(-1, keepdims=True))], -1)
    return gaze.astype(np.float32)


def graph() -> GazeGraph:
    return build(looks(4000), np.ones(4000, np.float32), threshold=4.0)


def drawn_eye(x: float, y: float, lid: float) -> np.ndarray:  # [400, 400] u8
    """A dark disc on a bright ellipse on grey skin."""
    rows, columns = np.mgrid[:400, :400].astype(np.float32)
    picture = np.full((400, 400), 140.0, np.float32)
    height = max(70 * lid, 1.0)
    opening = ((columns - 200) / 110) ** 2 + ((rows - 200) / height) ** 2 < 1
    picture[opening] = 220
    iris = (columns - 200 - 200 * x) ** 2 + (rows - 200 + 200 * y) ** 2 < 45**2
    picture[opening & iris] = 60
    picture[:, :120] -= 30  # the nose is darker: left and right differ
    return picture.astype(np.uint8)


def pair(seed: int = 0) -> np.ndarray:
    x, y, lid = np.random.default_rng(seed).uniform((-0.2, -0.2, 0.2), (0.2, 0.2, 1))
    return np.stack([drawn_eye(x, y, lid), drawn_eye(x - 0.1, y, lid)])
