"""Stage "eyes": train the eye encoder on the capture stage's renders (paper section 5.2).

Gaze, lid opening, the upper face's rig channels and validity are regressed from the features, of
which 80 for each eye are the condition e. A small map from gaze and rig back to features is fitted,
too: it makes e for the denoiser's training data and for lost cameras. Test subjects are held out.
The stage "wide-eyes" continues from here.
"""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from encoder.eyes.format import GAZE_UNIT, EyeNetConfig, unit
from encoder.eyes.format import PRESETS as NETS
from encoder.eyes.network import EyeNet
from encoder.nn import checkpoint
from encoder.training import loop
from encoder.training.checkpoints import load_eye_net
from encoder.training.presets import Presets
from encoder.training.streams.eye_pictures import EyePictures, augmented, standard

TRUTH = "made by rules; pictures rendered by the capture stage"
OPEN_ENOUGH = 0.25  # lid opening from which gaze is visible and counts
NEAR, WIDE = 0.35, 0.5  # relative gaze is fitted up to these sines (20 degrees), from this lid on
RELATIVE_RIDGE = 10.0
LID = 2  # of the heads' rows: gaze, lid, validity, rig
TEST_SHARE = 10  # every tenth subject is never trained on


@dataclass(frozen=True, kw_only=True)
class EyesConfig:
    pictures: Path  # folder with eyes_*.npz
    output: Path  # checkpoint, without suffix
    run: loop.RunSettings
    start: Path | None = None  # checkpoint to go on from, without suffix; its finder and meter stay
    net: EyeNetConfig = NETS["default"]
    steps: int = 12_000
    batch: int = 64
    rate: float = 2e-3


preset = Presets(
    EyesConfig,
    {
        "debug": {"net": NETS["debug"], "steps": 2, "batch": 8},
        "default": {},
        "paper": {"steps": 200_000},
    },
)


def losses(net: EyeNet, data: EyePictures, pairs: np.ndarray) -> dict[str, Tensor]:
    """Losses on pairs of pictures `pairs` [B / 4] and on other pictures of the same people as the
    same cameras would see them, all randomly distorted.
    """
    subject: np.ndarray = data.subject[::2]
    after, before = (pairs + 1) % len(subject), (pairs - 1) % len(subject)
    again = np.where(subject[after] == subject[pairs], after, before)
    chosen = np.concatenate([pairs, again])
    chosen = (2 * chosen[:, None] + np.arange(2)).ravel()  # left, right, left, right ..
    x, valid = augmented(data.pictures[chosen], times=2)
    out = net(x)
    gaze, lids, rig = (
        torch.from_numpy(array[chosen]) for array in (data.gaze, data.lids, data.rig)
    )
    weight = valid * torch.where(lids > OPEN_ENOUGH, 1.0, 0.02)
    both = net.together(out.features.float().unflatten(0, (-1, 2)), out.gaze.unflatten(0, (-1, 2)))
    both_seen = weight.unflatten(0, (-1, 2)).amin(1).repeat_interleave(2)
    first, second = (out.features.float() @ net.relative[:-1]).chunk(2)
    same_person = torch.from_numpy(np.repeat(subject[again] == subject[pairs], 2))
    both_moments = torch.minimum(*weight.chunk(2)) * same_person
    turned = torch.sub(*gaze.chunk(2))
    synthesised = net.synthesise(gaze, rig)
    features = out.features.float().detach()
    result = {
        "gaze": gaze_loss(out.gaze, gaze, weight),
        "pair": gaze_loss(both.flatten(0, 1), gaze, both_seen),
        "relative": gaze_loss(first - second, turned, both_moments),
        "lid": ((out.lid.float() - lids).abs() * valid).mean(),
        "rig": ((out.rig.float() - rig).square().mean(1) * valid).mean(),
        "valid": functional.binary_cross_entropy_with_logits(out.valid.float(), valid.float()),
        "synthesis": ((synthesised - features).square().mean(1) * valid).mean(),
    }
    weights = {"gaze": 1.0, "pair": 1.0, "relative": 1.0, "lid": 1.5, "rig": 2.0, "valid": 0.2}
    weights["synthesis"] = 1.0
    return result | {"total": sum((weights[k] * v for k, v in result.items()), torch.zeros(()))}


def gaze_loss(actual: Tensor, expected: Tensor, weight: Tensor) -> Tensor:  # [B, 2] x 2, [B]
    away = functional.smooth_l1_loss(
        actual.float() / GAZE_UNIT, expected / GAZE_UNIT, reduction="none", beta=0.1
    )
    return (away.mean(1) * weight).sum() / weight.sum().clamp(min=1)


def run(config: EyesConfig) -> dict[str, float]:
    """Train, evaluate on held-out subjects, and write the encoder with its card."""
    torch.manual_seed(config.run.seed)
    pictures = EyePictures.load(config.pictures)
    held_out = pictures.subject % TEST_SHARE == TEST_SHARE - 1
    train, test = pictures.where(~held_out), pictures.where(held_out)
    net, wide = started(config)

    def step_losses(step: int, rng: np.random.Generator) -> dict[str, Tensor]:
        return losses(net, train, rng.integers(len(train.lids) // 2, size=config.batch // 4))

    metrics, curve = loop.train(
        "eyes", {"net": net}, step_losses, steps=config.steps, rate=config.rate, run=config.run
    )
    net.eval()
    fit_spreads(net, train)
    fit_relative(net, train)
    fit_lid(net, train)
    if len(test.lids):
        metrics |= judge(net, test)
    card = {
        "kind": "eyes",
        "config": asdict(net.config),
        "data": {"rendered eyes": "made by rules"},
        "truth": TRUTH,
        "steps": config.steps,
        "pictures": len(train.lids),
        **wide,
        **config.run.card(metrics, curve),
    }
    checkpoint.save(config.output, loop.halved(net.state_dict()), card)
    return metrics


def started(config: EyesConfig) -> tuple[EyeNet, dict[str, Any]]:
    """The network to train, and the card entries of the parts that stay unchanged."""
    if config.start is None:
        return EyeNet(config.net), {}
    net, card = load_eye_net(config.start)
    net.train()  # its batch norms learn on
    for part in (net.finder, net.meter):
        part.requires_grad_(False)
    return net, {"started_from": card["sha256"]} | {k: card[k] for k in ("wide",) if k in card}


@torch.no_grad()
def predict(net: EyeNet, x: Tensor) -> list[np.ndarray]:
    """[n, 1, 100, 100] -> features, gaze, lid, valid, rig, in batches."""
    parts = [net(part) for part in x.split(256)]
    return [torch.cat(columns).numpy() for columns in zip(*parts, strict=True)]


@torch.no_grad()
def fit_spreads(net: EyeNet, data: EyePictures, count: int = 4096) -> None:
    """Scatter of features about the synthesised ones: from frame to frame, and between subjects.

    Cameras sit still, so what shifts and light add to the pictures counts as constant of a subject.
    """
    chosen = _some_people(data, count)
    gaze, rig = torch.from_numpy(data.gaze[chosen]), torch.from_numpy(data.rig[chosen])
    expected = net.synthesise(gaze, rig).numpy()
    subject = data.subject[chosen]
    _, place = np.unique(subject, return_inverse=True)
    still = predict(net, standard(torch.from_numpy(data.pictures[chosen]).float()))[0] - expected
    means = np.stack([np.bincount(place, c) / np.bincount(place) for c in still.T], 1)
    frame = np.cov((still - means[place]).T)
    x, valid = augmented(data.pictures[chosen])
    every = (predict(net, x)[0] - expected)[valid.numpy()]
    for buffer, covariance in (
        (net.frame_spread, frame),
        (net.subject_spread, np.cov(every.T) - frame),
    ):
        values, vectors = np.linalg.eigh(covariance)
        root = vectors * np.sqrt(np.maximum(values, 0))
        buffer.copy_(torch.from_numpy(root @ vectors.T))


@torch.no_grad()
def fit_relative(net: EyeNet, data: EyePictures, count: int = 80_000) -> None:
    """Least squares from features to gaze, both relative to the mean of the same eye."""
    data = data.where(_some_people(data, count))
    eye = 2 * data.subject + np.arange(len(data.lids)) % 2
    seen = (data.lids > WIDE) & (np.abs(data.gaze).max(1) < NEAR)
    pictures, gaze = data.pictures[seen], data.gaze[seen].astype(np.float64)
    features = predict(net, standard(torch.from_numpy(pictures).float()))[0].astype(np.float64)
    _, place, sizes = np.unique(eye[seen], return_inverse=True, return_counts=True)

    def centred(rows: np.ndarray) -> np.ndarray:
        means = np.stack([np.bincount(place, c) / sizes for c in rows.T], 1)
        return rows - means[place]

    x, y = centred(features), centred(gaze)
    weight = np.linalg.solve(x.T @ x + RELATIVE_RIDGE * np.eye(x.shape[1]), x.T @ y)
    bias = (gaze - features @ weight).mean(0)
    net.relative.copy_(torch.from_numpy(np.concatenate([weight, bias[None]])))


@torch.no_grad()
def fit_lid(net: EyeNet, data: EyePictures, count: int = 80_000, rounds: int = 12) -> None:
    """Fit the opening to features of undistorted pictures, by least absolute error."""
    data = data.where(_some_people(data, count))
    features = predict(net, standard(torch.from_numpy(data.pictures).float()))[0]
    x = np.concatenate([features, np.ones((len(features), 1))], 1).astype(np.float64)
    row = np.append(net.heads.weight[LID].numpy(), float(net.heads.bias[LID])).astype(np.float64)
    for _ in range(rounds):  # least squares, weighted by what was left
        weight = 1 / np.maximum(np.abs(x @ row - data.lids), 1e-3)
        row = np.linalg.solve((x * weight[:, None]).T @ x, (x * weight[:, None]).T @ data.lids)
    net.heads.weight[LID] = torch.from_numpy(row[:-1])
    net.heads.bias[LID] = float(row[-1])


def _some_people(data: EyePictures, count: int) -> np.ndarray:
    """Rows [n] bool of so many people that they have about `count` pictures."""
    people = np.unique(data.subject)
    share = min(1.0, count / len(data.lids))
    kept = np.linspace(0, len(people) - 1, max(1, int(share * len(people)))).astype(int)
    return np.isin(data.subject, people[kept])


def judge(net: EyeNet, data: EyePictures) -> dict[str, float]:
    """Errors on undistorted pictures."""
    x = standard(torch.from_numpy(data.pictures).float())
    _, gaze, lid, valid, _ = predict(net, x)
    seen = data.lids > OPEN_ENOUGH
    off = gaze_error_deg(unit(gaze), unit(data.gaze))[seen]
    return {
        "heldout_gaze_deg_median": float(np.median(off)),
        "heldout_gaze_deg_p95": float(np.percentile(off, 95)),
        "heldout_lid_mae": float(np.abs(np.clip(lid, 0, 1) - data.lids).mean()),
        "heldout_valid_share": float((valid > 0).mean()),
    }


def gaze_error_deg(actual: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """Unit vectors [..., 3] -> degrees between them [...]."""
    chord = np.linalg.norm(actual.astype(np.float64) - expected, axis=-1)
    return np.degrees(2 * np.arcsin(np.clip(chord / 2, 0, 1)))
