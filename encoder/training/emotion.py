"""Stage "emotion": zero convolutions between the blocks of the frozen student (paper section 5.1).

L_face asks the meshes to look like emotional truth; L_lip asks the lips to go on moving, opening
and shutting as the neutral model moves them, for the same sound and noise, in the emotion's style.
Trained on the one-step student itself, so that live driving stays one step. Also from here: direct
fine-tuning, the paper's ablation, in which every weight learns and nothing but L_face is asked for.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from encoder import checkpoint
from encoder.capture.emotion import EMOTIONS, LABELS, rigs
from encoder.denoiser import Denoiser
from encoder.emotion import zero_convs
from encoder.training import loop
from encoder.training.diffusion import fold_gaze, load_denoiser
from encoder.training.emotion_streams import SWELL, EmotionStreams
from encoder.training.geometry import Face, contact_loss, velocity_loss
from encoder.zero_conv import ZeroConvConfig, ZeroConvs
from sensors.types import InputError

NEAR_MM = 2.0  # a gap of the inner lips; a smaller one is about to be a closure
CONTACT_WEIGHT = 40.0  # mm^2: closures are rare, and a hair's breadth undoes them
CONVOLUTION_RATE = 1e-2
TRUTH = (
    "made by rules: action units laid over speech; half the streams with an acted voice, half with "
    "a neutral one"
)


@dataclass(frozen=True)
class EmotionFace:
    """The frozen decoder as this stage sees it."""

    whole: Face  # for L_face
    lips: Face  # for L_lip
    gaps: Callable[[Tensor], Tensor]  # codes [B, T, 256] -> [B, T, P, 3] mm between inner lips


@dataclass(frozen=True, kw_only=True)
class EmotionConfig:
    streams: Path
    student: Path  # the model to extend, without suffix
    output: Path  # where "emotion" goes (and "student", if it was fine-tuned): a folder
    run: loop.Run
    start: Path | None = None  # convolutions to start from, without suffix; None: zero
    fine_tune: bool = False  # the ablation: every weight of the student learns, without L_lip
    steps: int = 3000
    batch: int = 16
    frames: int = 100
    rate: float = CONVOLUTION_RATE
    # of L_lip against L_face, both in mm^2; 0: an ablation. 3 made smiles narrow and mouths timid
    lip_weight: float = 0.25


PRESETS: dict[str, dict[str, Any]] = {
    "debug": {"steps": 2, "batch": 2, "frames": 12},
    "default": {},
    "paper": {"steps": 30_000, "batch": 128, "rate": 1e-5},
}


def preset(name: str, **settings: Any) -> EmotionConfig:
    """`settings` win over the preset."""
    return EmotionConfig(**{**PRESETS[name], **settings})


def face_loss(predicted: Tensor, truth: Tensor, weights: Tensor) -> Tensor:
    """L_face: vertices [B, T, V, 3] mm -> weighted mean squared distance, mm^2."""
    return ((predicted - truth).square().sum(-1) * weights.to(predicted)).mean()


@dataclass(frozen=True)
class LipStyle:
    """What each emotion does to lips that speak, as the rules have it."""

    layer: Tensor  # [labels, 256] code that is added
    size: Tensor  # [labels] by how much more the mouth moves at strength 1

    @staticmethod
    def of(face: Face) -> "LipStyle":
        size = torch.tensor([EMOTIONS[name].mouth - 1 for name in LABELS])
        return LipStyle(torch.from_numpy(face.rig_to_code(rigs())), size)

    def lay_over(self, neutral: Tensor, mixture: Tensor) -> Tensor:
        """Codes [B, T, 256], mixture [B, labels] -> codes of the same speech in the emotion."""
        size = 1 + (mixture / SWELL) @ self.size.to(mixture)
        return size[:, None, None] * neutral + (mixture @ self.layer.to(mixture))[:, None]


def lip_loss(codes: Tensor, neutral: Tensor, styled: Tensor, face: EmotionFace) -> Tensor:
    """L_lip: codes [B, T, 256] -> mm^2, against the neutral model's, plain and in the style.

    The gaps between the inner lips, where they touch, and the lips' motion from frame to frame.
    Shut lips stay shut, as in the rules: only open ones take the emotion's style. Where the lips
    are is left to L_face, else there would be no smile.
    """
    gaps, shown = face.gaps(neutral), face.gaps(codes)
    shut = (1 - gaps[..., 1].mean(-1).abs() / NEAR_MM).clamp(min=0)  # 1: the lips touch
    wanted = torch.lerp(face.gaps(styled), gaps, shut[..., None, None])
    gap = (shown - wanted).square().sum(-1).mean()
    lips = [face.lips.vertices(x) for x in (codes, styled)]
    motion = velocity_loss(lips[0], lips[1], face.lips.weights)
    return gap + motion + CONTACT_WEIGHT * contact_loss(shown, gaps)


def losses(
    student: Denoiser,
    zero: ZeroConvs,
    frozen: Denoiser,
    batch: tuple[Tensor, ...],  # codes, audio, scaled gaze, mixture
    face: EmotionFace,
    style: LipStyle,
    lip_weight: float,
) -> dict[str, Tensor]:
    codes, audio, gaze, mixture = batch
    noise = torch.randn_like(codes)
    tau = torch.full((len(noise),), student.config.num_steps, device=noise.device)
    z = student.unstandardise(student(noise, tau, audio, gaze, emotion=zero(mixture)))
    truth = face.whole.vertices(codes)
    result = {"face": face_loss(face.whole.vertices(z), truth, face.whole.weights)}
    total = result["face"]
    if lip_weight:
        with torch.no_grad():
            neutral = frozen.unstandardise(frozen(noise, tau, audio, gaze))
            styled = style.lay_over(neutral, mixture)
        result["lip"] = lip_loss(z, neutral, styled, face)
        total = total + lip_weight * result["lip"]
    return result | {"total": total}


def load_zero_convs(path: Path, config: ZeroConvConfig) -> ZeroConvs:
    """Those of a checkpoint, whatever student they extended; InputError if their shapes differ."""
    zero = zero_convs(*checkpoint.load(path, "emotion"), path)
    if zero.config != config:
        raise InputError(
            f"--start {path}: expected convolutions for {config}, got {zero.config}; "
            "take the file away to start from zero"
        )
    return zero


def run(config: EmotionConfig, face: EmotionFace) -> dict[str, float]:
    """Train and write the zero convolutions with their card."""
    torch.manual_seed(config.run.seed)
    streams = EmotionStreams.load(config.streams)
    frozen, card = load_denoiser(config.student, "student")
    student, _ = load_denoiser(config.student, "student")
    for model in (frozen, student):
        fold_gaze(model, inverse=True).to(config.run.device).requires_grad_(False)
    zero = ZeroConvs(ZeroConvConfig(labels=LABELS, places=student.config.places))
    if config.start:
        zero = load_zero_convs(config.start, zero.config)
    zero.to(config.run.device)
    modules: dict[str, nn.Module] = {"zero": zero}
    if config.fine_tune:
        modules["student"] = student.requires_grad_(True)
        # Adam takes steps of one size: on longer embeddings the convolutions learn as fast as alone
        zero.embeddings *= CONVOLUTION_RATE / config.rate
    style = LipStyle.of(face.whole)
    lip_weight = 0.0 if config.fine_tune else config.lip_weight

    def step_losses(step: int, rng: Any) -> dict[str, Tensor]:
        drawn = streams.draw(config.batch, config.frames, face.whole, rng)
        batch = tuple(tensor.to(config.run.device) for tensor in drawn)
        return losses(student, zero, frozen, batch, face, style, lip_weight)

    metrics, curve = loop.train(
        "emotion", modules, step_losses, steps=config.steps, rate=config.rate, run=config.run
    )
    facts = {
        "data": streams.about["sources"],
        "truth": TRUTH,
        "steps": config.steps,
        "lip_weight": lip_weight,
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
