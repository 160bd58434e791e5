"""Stage "emotion": zero convolutions between the blocks of the frozen student (paper section 5.1).

L_face pulls the meshes to the emotional truth. L_lip makes the lips shut where the neutral model
rightly shuts them for the same sound and noise, and otherwise move as the truth's do. L_calm (not
in the paper) leaves blinks and glances to the neutral model: what an emotion adds above the mouth
changes slowly, to both eyes' lids the same, and where no face has numbers it adds none. Trained on
the one-step student itself, so that live driving stays one step. Also does direct fine-tuning, in
which all weights are trained; the paper's ablation trains it with L_face alone.
"""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from encoder.capture.motion.channels import RIG_INDEX, RIG_NAMES, SPEECH_NAMES
from encoder.denoiser.config import ZeroConvConfig
from encoder.denoiser.model import Denoiser
from encoder.denoiser.zero_conv import ZeroConvs
from encoder.emotion.labels import LABELS
from encoder.nn import checkpoint
from encoder.training import loop
from encoder.training.checkpoints import load_denoiser, load_zero_convs
from encoder.training.geometry import TrainingFace, closest
from encoder.training.presets import Presets
from encoder.training.stages.diffusion import fold_gaze
from encoder.training.streams.emotion import EmotionStreams
from sensors.types import InputError

KEPT_WEIGHT = 40.0  # mm: closures are rare, and a small gap undoes them
CONVOLUTION_RATE = 1e-2
LIDS = "eyeBlink", "eyeSquint", "eyeWide"  # both eyes' have the same part in every emotion
RIG_SIZE = 55  # channels, and the tongue's tip and back
TRUTH = (
    "made by rules: action units laid over speech; half the streams with an acted voice, half with "
    "a neutral one"
)


@dataclass(frozen=True, kw_only=True)
class EmotionConfig:
    streams: Path
    student: Path  # the model to extend, without suffix
    output: Path  # where "emotion" goes (and "student", if it was fine-tuned): a folder
    run: loop.RunSettings
    start: Path | None = None  # convolutions to start from, without suffix; None: zero
    fine_tune: bool = False  # an ablation: all weights of the student are trained
    steps: int = 3000
    batch: int = 16
    frames: int = 100
    rate: float = CONVOLUTION_RATE
    # mm, of L_lip against L_face; 0: an ablation. With 4, lips of real voices end 4 % farther
    lip_weight: float = 10.0
    calm_weight: float = 0.5  # of L_calm; 0: an ablation


preset = Presets(
    EmotionConfig,
    {
        "debug": {"steps": 2, "batch": 2, "frames": 12},
        "default": {},
        "paper": {"steps": 30_000, "batch": 128, "rate": 1e-5},
    },
)


@dataclass(frozen=True)
class Calm:
    """Maps of codes to what L_calm looks at."""

    above: Tensor  # [256, C] channels that speech does not move, each as far as it moves the code
    sides: Tensor  # [256, 3] the left eye's lids less the right one's, the same way
    free: Tensor  # [256, 256] what no channel and no tongue moves

    @staticmethod
    def of(face: TrainingFace) -> "Calm":
        rows = torch.from_numpy(face.rig_to_code(np.eye(RIG_SIZE, dtype=np.float32))).double()
        read = torch.linalg.pinv(rows)  # [256, 55]
        names = [i for i, name in enumerate(RIG_NAMES) if name not in SPEECH_NAMES]
        moved, free = read * rows.norm(dim=1), torch.eye(len(read)) - read @ rows
        left, right = ([RIG_INDEX[f"{lid}_{side}"] for lid in LIDS] for side in "LR")
        sides = moved[:, left] - moved[:, right]
        return Calm(moved[:, names].float(), sides.float(), free.float())


def face_loss(predicted: Tensor, truth: Tensor, weights: Tensor) -> Tensor:
    """L_face: vertices [B, T, V, 3] mm -> weighted mean squared distance, mm^2."""
    return ((predicted - truth).square().sum(-1) * weights.to(predicted)).mean()


def lip_loss(
    shown: Tensor, truth: Tensor, gaps: Tensor, neutral_gaps: Tensor, true_gaps: Tensor
) -> Tensor:
    """L_lip: spans [B, T, 2] and gaps [B, T, P, 3] mm -> mm.

    The error of the spans is the paper's lip sync, |corners| + |centres|. Where the neutral model
    rightly shuts the lips, ours must shut them within two frames; its wrong closures are not kept.
    (With a squared error of the gaps, which leads to the mean instead of the median, lips were a
    tenth further from the rule-made truth.)
    """
    sync = (shown - truth).abs().sum(-1).mean()
    right = torch.minimum(closest(neutral_gaps), closest(true_gaps))
    return sync + KEPT_WEIGHT * (right - closest(gaps)).clamp(min=0).square().mean()


def calm_loss(added: Tensor, calm: Calm) -> Tensor:
    """L_calm: what an emotion adds to codes [B, T, 256] -> how fast it changes above the mouth, how
    much more of it the lids of one eye get, and how much no face has, in the code's units,
    squared."""
    above, sides, free = (added @ read.to(added) for read in (calm.above, calm.sides, calm.free))
    parts = above.diff(dim=1), sides, free
    return torch.stack([part.square().sum(-1).mean() for part in parts]).sum()


def losses(
    student: Denoiser,
    zero: ZeroConvs,
    frozen: Denoiser,
    batch: tuple[Tensor, ...],  # codes, audio, scaled gaze, mixture
    face: TrainingFace,
    config: EmotionConfig,
    calm: Calm,
) -> dict[str, Tensor]:
    codes, audio, gaze, mixture = batch
    noise = torch.randn_like(codes)
    tau = torch.full((len(noise),), student.config.num_steps, device=noise.device)
    z = student.unstandardise(student(noise, tau, audio, gaze, emotion=zero(mixture)))
    truth = face.vertices(codes)
    result = {"face": face_loss(face.vertices(z), truth, face.weights)}
    total = result["face"]
    if not (config.lip_weight or config.calm_weight):
        return result | {"total": total}
    with torch.no_grad():
        neutral = frozen.unstandardise(frozen(noise, tau, audio, gaze))
    if config.lip_weight:
        gaps = (face.gaps(x) for x in (z, neutral, codes))
        result["lip"] = lip_loss(face.spans(z), face.spans(codes), *gaps)
        total = total + config.lip_weight * result["lip"]
    if config.calm_weight:
        result["calm"] = calm_loss(z - neutral, calm)
        total = total + config.calm_weight * result["calm"]
    return result | {"total": total}


def start_from(path: Path, config: ZeroConvConfig) -> tuple[ZeroConvs, str]:
    """The convolutions of a checkpoint and its sha256; InputError if their shapes differ."""
    zero, card = load_zero_convs(path)
    if zero.config != config:
        raise InputError(
            f"--start {path}: expected convolutions for {config}, got {zero.config}; "
            "take the file away to start from zero"
        )
    return zero, card["sha256"]


def run(config: EmotionConfig, face: TrainingFace) -> dict[str, float]:
    """Train and write the zero convolutions with their card."""
    torch.manual_seed(config.run.seed)
    streams = EmotionStreams.load(config.streams)
    frozen, card = load_denoiser(config.student, "student")
    student, _ = load_denoiser(config.student, "student")
    for model in (frozen, student):
        fold_gaze(model, inverse=True).to(config.run.device).requires_grad_(False)
    zero = ZeroConvs(ZeroConvConfig(labels=LABELS, places=student.config.places))
    origin: dict[str, str] = {}
    if config.start:
        zero, origin["started_from"] = start_from(config.start, zero.config)
    zero.to(config.run.device)
    calm = Calm.of(face)
    modules: dict[str, nn.Module] = {"zero": zero}
    if config.fine_tune:
        modules["student"] = student.requires_grad_(True)
        # Adam's steps have one size: with longer embeddings the convolutions learn as fast as alone
        zero.embeddings *= CONVOLUTION_RATE / config.rate

    def step_losses(step: int, rng: Any) -> dict[str, Tensor]:
        drawn = streams.draw(config.batch, config.frames, face, rng)
        batch = tuple(tensor.to(config.run.device) for tensor in drawn)
        return losses(student, zero, frozen, batch, face, config, calm)

    metrics, curve = loop.train(
        "emotion", modules, step_losses, steps=config.steps, rate=config.rate, run=config.run
    )
    facts = {
        "data": streams.about["sources"],
        "truth": TRUTH,
        "steps": config.steps,
        "lip_weight": config.lip_weight,
        "calm_weight": config.calm_weight,
        **origin,
        **config.run.card(metrics, curve),
    }
    sha256 = card["sha256"]
    if config.fine_tune:
        kept = {key: card[key] for key in ("config", "audio_sha256", "guidance") if key in card}
        path = config.output / "student"
        checkpoint.save(path, fold_gaze(student).state_dict(), {"kind": "student", **kept, **facts})
        sha256 = checkpoint.load(path, "student")[1]["sha256"]
    checkpoint.save(
        config.output / "emotion",
        loop.halved(zero.state_dict()),
        {
            "kind": "emotion",
            "config": asdict(zero.config),
            "student_sha256": sha256,
            "embeddings": "an axis a label; what it means is learned by the convolutions",
            **facts,
        },
    )
    return metrics
