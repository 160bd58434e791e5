"""Stage "contact": the head that shuts the lips of a frozen student (encoder/denoiser/contact.py).

Runs after distill. Only the head is trained, on the student's output at tau = N for a clip's sound:
lips should be as far open as the truth's, touch where those touch, within two frames (the student's
contact loss), and move as far, since an error alone would make them move too little.
"""

import json
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from encoder.capture.motion.channels import MOUTH_CLOSE, RIG_NAMES
from encoder.denoiser.config import HEAD
from encoder.denoiser.contact import Contact
from encoder.denoiser.model import Denoiser, headless
from encoder.nn import checkpoint
from encoder.training import loop
from encoder.training.checkpoints import check_hears, load_denoiser
from encoder.training.geometry import TrainingFace, contact_loss
from encoder.training.presets import Presets
from encoder.training.stages.diffusion import fold_gaze
from encoder.training.streams.streams import Streams


@dataclass(frozen=True, kw_only=True)
class ContactConfig:
    streams: Path
    student: Path  # without suffix; what is written there or to `output` has the head
    output: Path
    run: loop.RunSettings
    without: tuple[str, ...] = ()  # talkers whose tracked motion is left out
    hidden: int = 32
    steps: int = 3000
    batch: int = 16
    frames: int = 100
    rate: float = 2e-3
    contact_weight: float = 4.0
    gap_weight: float = 0.2  # per mm^2
    spread_weight: float = 0.6  # per mm^2
    effort_weight: float = 0.02  # per mm^2 that the head moves the lips


preset = Presets(
    ContactConfig,
    {
        "debug": {"steps": 2, "batch": 2, "frames": 12},
        "default": {},
        "paper": {"steps": 20_000, "batch": 64},
    },
)


def new_head(
    student: Denoiser, face: TrainingFace, hidden: int, heard: int | None = None
) -> Contact:
    """An untrained head, which changes nothing; its buffers map the student's codes to mm."""
    config = student.config
    heard = heard or config.contact_dim
    head = Contact(config.expression_dim, heard, hidden, config.reach_mm)

    def opening(codes: Tensor) -> Tensor:
        return face.gaps(codes)[..., 1].mean(-1)

    row = opening(torch.eye(config.expression_dim))
    closing = np.zeros(len(RIG_NAMES), np.float32)
    closing[MOUTH_CLOSE] = 1
    shut = torch.from_numpy(face.rig_to_code(closing).astype(np.float32))
    head.gap.copy_(row * student.expression_std)
    head.rest.copy_(row @ student.expression_mean)
    head.shut.copy_(shut / (row @ shut) / student.expression_std)
    return head


def losses(
    head: Contact,
    student: Denoiser,  # frozen, without a head
    batch: tuple[Tensor, ...],  # codes, audio, scaled gaze, weight
    scale: tuple[Tensor, Tensor],  # mean and spread of the audio features
    face: TrainingFace,
    config: ContactConfig,
) -> dict[str, Tensor]:
    codes, audio, gaze, _ = batch
    tau = torch.full((len(codes),), student.config.num_steps, device=codes.device)
    with torch.no_grad():
        x0 = student(torch.randn_like(codes), tau, audio, gaze)
    heard = (audio[..., -student.config.contact_dim :] - scale[0]) / scale[1]
    moved = head(x0, heard)
    gaps = face.gaps(student.unstandardise(moved)), face.gaps(codes)
    shown, wanted = (gap[..., 1].mean(-1) for gap in gaps)
    result = {
        "contact": contact_loss(*gaps),
        "gap": (shown - wanted).square().mean(),
        "spread": (shown.std(1) - wanted.std(1)).square().mean(),
        "effort": ((moved - x0) @ head.gap).square().mean(),
    }
    total = sum(getattr(config, f"{name}_weight") * value for name, value in result.items())
    return result | {"total": total}  # type: ignore[dict-item]


@torch.no_grad()
def fold_scale(layer: nn.Linear, mean: Tensor, spread: Tensor) -> None:
    """In place: turn a layer trained on standardised features (its last inputs) into one for plain
    features."""
    columns = layer.weight[:, -len(mean) :]
    columns /= spread
    bias: Tensor = layer.bias
    bias -= columns @ mean


def run(config: ContactConfig, face: TrainingFace) -> dict[str, float]:
    """Train the head and write the student with it; all other tensors unchanged."""
    torch.manual_seed(config.run.seed)
    streams = Streams.load(config.streams, face, config.without)
    tensors, card = checkpoint.load(config.student, "student")
    check_hears(config.student, card, streams.about)
    student = headless(load_denoiser(config.student, "student")[0])
    head = new_head(student, face, config.hidden).to(config.run.device)
    fold_gaze(student, inverse=True).to(config.run.device).requires_grad_(False)
    every, dim = max(len(streams.features) // 40, 1), student.config.contact_dim
    heard = streams.features[::every][streams.allowed[::every]]
    flat = torch.from_numpy(heard[:, -dim:]).float()
    scale = flat.mean(0), flat.std(0) + 1e-3
    there = scale[0].to(config.run.device), scale[1].to(config.run.device)

    def step_losses(step: int, rng: np.random.Generator) -> dict[str, Tensor]:
        drawn = streams.draw(config.batch, config.frames, rng, card.get("lookahead", 0))
        batch = tuple(tensor.to(config.run.device) for tensor in drawn)
        return losses(head, student, batch, there, face, config)

    metrics, curve = loop.train(
        "contact", {"head": head}, step_losses, steps=config.steps, rate=config.rate,
        run=config.run,
    )  # fmt: skip
    fold_scale(head.cpu().listen, *scale)
    tensors = {name: tensor for name, tensor in tensors.items() if not name.startswith(HEAD)}
    tensors |= {
        HEAD + name: tensor for name, tensor in checkpoint.arrays(head.state_dict()).items()
    }
    trained = {"steps": config.steps, **config.run.card(metrics, curve)}
    sizes = asdict(replace(student.config, contact=config.hidden))
    checkpoint.save(
        config.output, checkpoint.quantised(tensors), {**card, "config": sizes, "contact": trained}
    )
    follow(config.output, card["sha256"])
    return metrics


def follow(student: Path, before: str) -> None:
    """Update the cards of weights that extend the student: they stay valid, only the head is
    new."""
    now = json.loads(student.with_suffix(".json").read_text())
    for name in ("student_eyes", "emotion"):
        path = student.with_name(name)
        if not path.with_suffix(".json").is_file():
            continue
        card = json.loads(path.with_suffix(".json").read_text())
        sees = name == "student_eyes"
        named, key = (card.get("audio_model", {}), "sha256") if sees else (card, "student_sha256")
        if named.get(key) == before:
            named[key] = now["sha256"]
            if sees:
                card["config"] |= {k: now["config"][k] for k in ("contact", "reach_mm")}
            checkpoint.write_card(path, card)
