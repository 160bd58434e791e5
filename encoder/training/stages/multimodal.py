"""Stage "multimodal": the student takes eye features e instead of gaze g (paper section 5.2).

Starts from the distilled student that is conditioned on gaze, and stays a one-step model. The
target has two halves: the mouth is the audio model's own output for the same sound and noise, moved
a little towards the truth, so that the lips keep what was distilled; the upper face is the truth
that e shows (streams/eyes.py).
"""

from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from encoder.capture.motion.channels import RIG_NAMES, SPEECH_COLUMNS
from encoder.denoiser.model import Denoiser
from encoder.eyes.format import FEATURES
from encoder.nn import checkpoint
from encoder.training import loop
from encoder.training.checkpoints import check_hears, load_denoiser, load_eye_net
from encoder.training.geometry import TrainingFace, velocity_loss
from encoder.training.presets import Presets
from encoder.training.stages.diffusion import fold_gaze, weighted_error
from encoder.training.streams.eyes import Batch, EyeStreams

TRUTH = (
    "mouth: of the audio model, a fifth of the way to its truth; "
    "eyes, lids and brows: made by rules, seen by the eye encoder"
)
MOUTH_TRUTH = 0.2  # of the mouth's target: what is copied errs more than what it is copied from
# What eyes show is a matter of the frame, not of the past: attention stays the audio model's. Only
# these tensors are learned and written, 1.7 of 8.3 MB; `inference.load_student` adds the others.
LEARNED = ("null_condition", "input.", "output.", "norm.", *(
    f"blocks.{block}.{part}." for block in (0, 1) for part in ("up", "down")
))  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class MultimodalConfig:
    streams: Path
    student: Path  # the gaze model, without suffix
    eyes: Path  # the eye encoder, without suffix
    output: Path
    run: loop.RunSettings
    steps: int = 700
    batch: int = 16
    frames: int = 100
    rate: float = 6e-4
    lost: float = 0.3  # chance that an eye is lost for a part of a clip
    velocity_weight: float = 1.0
    distance_weight: float = 2.0
    silence: float = 0.1  # chance that a clip's eyes come with silence instead of its sound
    learned: tuple[str, ...] = LEARNED  # beginnings of tensors' names


preset = Presets(
    MultimodalConfig,
    {
        "debug": {"steps": 2, "batch": 2, "frames": 20},
        "default": {},
        "paper": {"steps": 25_000, "rate": 1e-4, "learned": ("",)},
    },
)


class Halves:
    """Combines the mouth of one code with the upper face of another, by channels of the rig."""

    def __init__(self, face: TrainingFace) -> None:
        rows = face.rig_to_code(np.eye(len(RIG_NAMES), dtype=np.float32))  # [53, 256]
        upper = [i for i in range(len(RIG_NAMES)) if i not in SPEECH_COLUMNS]
        inverse = np.linalg.pinv(rows)[:, upper]  # [256, U]
        self.upper = torch.from_numpy((inverse @ rows[upper]).astype(np.float32))  # [256, 256]

    def join(self, mouth: Tensor, upper: Tensor) -> Tensor:  # [B, T, 256] each
        return mouth + (upper - mouth) @ self.upper


@torch.no_grad()
def widened(student: Denoiser, streams: EyeStreams, rng: np.random.Generator) -> Denoiser:
    """A copy of the gaze model that takes e instead: a linear fit reads the gaze from e."""
    batch = streams.draw(24, 100, rng)
    e, gaze = batch.e.flatten(0, 1).numpy(), batch.scaled_gaze.flatten(0, 1).numpy()
    padded = np.concatenate([e, np.ones((len(e), 1), np.float32)], 1)
    ridge = 1e-2 * len(e) * np.eye(padded.shape[1])
    fit = np.linalg.solve(padded.T @ padded + ridge, padded.T @ gaze)
    fit = torch.from_numpy(fit.astype(np.float32))  # [161, 6]
    config = replace(student.config, condition="eyes", condition_dim=2 * FEATURES)
    model, tensors = Denoiser(config), dict(student.state_dict())
    weight = tensors["input.weight"]
    columns = weight[:, -student.config.condition_dim :]
    tensors["input.weight"] = torch.cat(
        [weight[:, : -student.config.condition_dim], columns @ fit[:-1].T], 1
    )
    tensors["input.bias"] = tensors["input.bias"] + columns @ fit[-1]
    tensors["null_condition"] = torch.from_numpy(e.mean(0))
    model.load_state_dict(tensors)
    return model


def losses(
    model: Denoiser, audio_model: Denoiser, halves: Halves, batch: Batch, face: TrainingFace,
    config: MultimodalConfig,
) -> dict[str, Tensor]:  # fmt: skip
    noise = torch.randn_like(batch.codes)
    tau = torch.full((len(noise),), model.config.num_steps)
    with torch.no_grad():
        said = audio_model.unstandardise(audio_model(noise, tau, batch.audio, batch.scaled_gaze))
        target = halves.join(torch.lerp(said, batch.codes, MOUTH_TRUTH), batch.codes)
    z = model(noise, tau, batch.audio, batch.e)
    code = model.unstandardise(z)
    faces = [face.vertices(codes) for codes in (code, target)]
    result = {
        "code": weighted_error(z, model.standardise(target), batch.weight),
        "velocity": velocity_loss(faces[0], faces[1], face.weights),
        "distance": (upper_distance(code - target, halves, face) * batch.weight).mean(),
    }
    total = result["code"] + config.velocity_weight * result["velocity"]
    return result | {"total": total + config.distance_weight * result["distance"]}


def upper_distance(
    off: Tensor, halves: Halves, face: TrainingFace
) -> Tensor:  # [B, T, 256] -> [B, T] mm
    """Distance of the upper face's vertices for an error `off` of the codes.

    Not squared: eye cameras show next to nothing of the brows, and a squared error would leave them
    slightly raised for good, at their mean; with this one they rest.
    """
    return (face.vertices(off @ halves.upper).square().sum(-1) + 1e-4).sqrt().mean(-1)


def run(config: MultimodalConfig, face: TrainingFace) -> dict[str, float]:
    """Fine-tune and write the student that is conditioned on e."""
    torch.manual_seed(config.run.seed)
    rng = np.random.default_rng(config.run.seed)
    net, eye_card = load_eye_net(config.eyes)
    streams = EyeStreams(config.streams, face, net.requires_grad_(False), config.lost)
    audio_model, card = load_denoiser(config.student, "student")
    check_hears(config.student, card, streams.streams.about)
    fold_gaze(audio_model, inverse=True).requires_grad_(False)
    model, halves = widened(audio_model, streams, rng), Halves(face)
    for name, parameter in model.named_parameters():
        parameter.requires_grad_(name.startswith(config.learned))
    silence = streams.silence()

    def step_losses(step: int, rng: np.random.Generator) -> dict[str, Tensor]:
        batch = streams.draw(config.batch, config.frames, rng)
        if silence is not None:
            silenced = torch.from_numpy(rng.random(config.batch) < config.silence)
            batch.audio[silenced] = silence
        return losses(model, audio_model, halves, batch, face, config)

    metrics, curve = loop.train(
        "multimodal", {"student": model}, step_losses, steps=config.steps, rate=config.rate,
        run=config.run,
    )  # fmt: skip
    facts = {
        "kind": "student",
        "config": asdict(model.config),
        "data": streams.streams.about["sources"],
        "truth": TRUTH,
        "audio_model": {key: card[key] for key in ("steps", "seed", "sha256")},
        "eyes_sha256": eye_card["sha256"],
        "steps": config.steps,
        **{key: card[key] for key in ("audio_sha256",) if key in card},
        **config.run.card(metrics, curve),
    }
    tensors = {k: v for k, v in model.state_dict().items() if k.startswith(config.learned)}
    checkpoint.save(config.output, checkpoint.quantised(tensors), facts)
    return metrics
