"""Stage "wide-eyes": an eye encoder learns to see eyes as real cameras show them.

Continues from the stage "eyes". Trains the finder (where the eye lies in a picture) and the meter
(whether there is an eye; lid, gaze and its uncertainty, pupil), which starts from the encoder's
convolutions. All else is unchanged, so students trained on the encoder's features fit the new file
as well: its card names the old one as `features_of`.
"""

from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from encoder.eyes.format import GAZE_UNIT
from encoder.eyes.network import EyeNet
from encoder.nn import checkpoint
from encoder.training import loop
from encoder.training.checkpoints import load_eye_net
from encoder.training.presets import Presets
from encoder.training.stages.eyes import OPEN_ENOUGH
from encoder.training.streams.wide_eyes import BatchCounts, WideBatch, WidePictures, draw

WEIGHTS = {
    "present": 0.4, "measured_lid": 1.5, "measured_gaze": 0.25, "pupil": 0.2,
    "found": 0.4, "place": 2.0, "size": 1.0, "turn": 1.0,
}  # fmt: skip
HALF_SHUT = 1.5  # how much more a lid below the half is to be read right


@dataclass(frozen=True, kw_only=True)
class WideEyesConfig:
    pictures: Path  # folder with wide_*.npz
    start: Path  # checkpoint of the stage "eyes", without suffix
    output: Path
    run: loop.RunSettings
    steps: int = 5500
    rate: float = 2e-3
    counts: BatchCounts = field(default_factory=BatchCounts)


preset = Presets(
    WideEyesConfig,
    {
        "debug": {"steps": 2, "counts": BatchCounts(4, 4, 2, 2)},
        "default": {},
        "paper": {"steps": 50_000},
    },
)


def losses(net: EyeNet, data: WidePictures, batch: WideBatch) -> dict[str, Tensor]:
    count = len(batch.index)
    gaze, lids = (torch.from_numpy(array[batch.index]) for array in (data.gaze, data.lids))
    gaze = torch.stack([gaze[:, 0] * batch.mirrored, gaze[:, 1]], 1) / GAZE_UNIT
    lids = lids.clamp(0, 1)
    measures, found = net.meter(batch.x).float(), net.finder(batch.whole).float()
    told = batch.told[:count]
    seen = told * (lids > OPEN_ENOUGH)
    eyes = measures[:count]
    half_shut = 1 + HALF_SHUT * (lids < 0.5)
    rows = {
        "present": _told(measures[:, 0], batch.shows, batch.told),
        "measured_lid": ((eyes[:, 1] - lids).abs() * told * half_shut).mean(),
        "measured_gaze": _doubted(eyes[:, 2:4], gaze, eyes[:, 4], seen, 0.5, 0.03),
        "pupil": _doubted(
            eyes[:, 5:7], batch.pupil, eyes[:, 7], seen * batch.pupil_seen, 0.3, 0.015
        ),
        "found": _told(found[:, 0], batch.shows, batch.told),
        "place": _near(found[:count, 1:3], batch.found[:, :2], told),
        "size": _near(found[:count, 3:4], batch.found[:, 2:3], told),
        "turn": _near(found[:count, 4:6], batch.found[:, 3:5], told),
    }
    return rows | {"total": sum((WEIGHTS[k] * v for k, v in rows.items()), torch.zeros(()))}


def _told(logits: Tensor, truth: Tensor, weight: Tensor) -> Tensor:
    away = functional.binary_cross_entropy_with_logits(logits, truth, reduction="none")
    return (away * weight).mean()


def _near(actual: Tensor, expected: Tensor, weight: Tensor) -> Tensor:
    away = functional.smooth_l1_loss(actual, expected, reduction="none", beta=0.05)
    return (away.sum(1) * weight).mean()


def _doubted(
    actual: Tensor, expected: Tensor, raw: Tensor, weight: Tensor, scale: float, floor: float
) -> Tensor:
    """Negative log-likelihood of a Laplace density, whose scale the network predicts, too."""
    spread = floor + scale * functional.softplus(raw + 0.5)
    away = (actual - expected).abs().sum(1) / spread + 2 * spread.log()
    return (away * weight).sum() / weight.sum().clamp(min=1)


def run(config: WideEyesConfig) -> dict[str, float]:
    """Train and write the encoder with its card."""
    torch.manual_seed(config.run.seed)
    data = WidePictures.load(config.pictures)
    net, card = load_eye_net(config.start)
    net.train()  # its batch norms learn on
    net.meter.convs.load_state_dict(net.convs.state_dict())
    net.meter.norms.load_state_dict(net.norms.state_dict())

    def step_losses(step: int, rng: np.random.Generator) -> dict[str, Tensor]:
        return losses(net, data, draw(data, config.counts, rng))

    learners = {"finder": net.finder, "meter": net.meter}
    metrics, curve = loop.train(
        "wide-eyes", learners, step_losses, steps=config.steps, rate=config.rate, run=config.run
    )
    wide = {"steps": config.steps, "pictures": len(data.lids), **config.run.card(metrics, curve)}
    words = {k: v for k, v in card.items() if k not in ("format", "sha256")}
    words |= {"config": asdict(net.config), "wide": wide}
    words["features_of"] = card.get("features_of", card["sha256"])
    checkpoint.save(config.output, loop.halved(net.state_dict()), words)
    return metrics
