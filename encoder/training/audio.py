"""Stage 1: train the audio encoder (paper section 4.3 uses wav2vec; none is public here).

Two teachers at once. Self-supervised: the contrastive loss of wav2vec 1.0 (of 2.0 for the centred
encoder). Supervised: linear heads on the stacked features of a frame must tell the mouth's curves,
the phone and the clean spectrum. Each kind of truth (rules, tracked, envelope) has its own mouth
head, since each moves its mouth in its own way; the heads only label voices without motion later.
"""

from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from encoder import checkpoint
from encoder.audio_encoder import PRESETS as ENCODERS
from encoder.audio_encoder import AudioEncoder, AudioEncoderConfig
from encoder.capture.dataset import PACK_SAMPLES_PER_FRAME, Clip, read_manifest, read_pack
from encoder.training import contrastive, loop, parallel
from encoder.training.augment import Crop, crop
from encoder.training.centred import CentredEncoder
from encoder.training.heads import Heads, load_heads, losses, mel_filters
from sensors.types import InputError


@dataclass(frozen=True, kw_only=True)
class AudioConfig:
    pack: Path
    output: Path  # without suffix: .safetensors and .json are added
    heads: Path  # likewise
    run: loop.Run
    start: Path | None = None  # an audio checkpoint of the same config to go on from
    encoder: AudioEncoderConfig = field(default_factory=lambda: ENCODERS["default"])
    centred: bool = False  # the ablation's encoder, which sees half a second ahead
    steps: int = 4600
    batch: int = 10
    frames: int = 60
    rate: float = 2e-3
    contrastive_weight: float = 0.2
    # share of the batch for each kind of truth
    shares: tuple[tuple[str, float], ...] = (
        ("rules", 0.4),
        ("emotional", 0.1),  # the same rules, other voices of the same speakers
        ("tracked", 0.25),
        ("envelope", 0.05),  # its only truth is loudness, which no encoder needs to be taught
        ("rest", 0.2),
    )


PRESETS: dict[str, dict[str, Any]] = {
    "debug": {"encoder": ENCODERS["debug"], "steps": 2, "batch": 2, "frames": 12},
    "default": {},
    "paper": {"steps": 100_000, "batch": 64, "frames": 100, "rate": 1e-3},
}


def stacked(encoder: AudioEncoder, audio: Tensor) -> Tensor:
    """[B, 800 T] at 24 kHz -> audio_features [B, T, 512]: the four features of each frame."""
    return _stack(encoder, encoder(audio[..., None]))


def _stack(encoder: AudioEncoder, features: Tensor) -> Tensor:
    count = PACK_SAMPLES_PER_FRAME // encoder.config.stride
    return features.reshape(len(features), -1, count * encoder.config.width)


def contrasted(
    encoder: AudioEncoder, audio: Tensor, predictor: contrastive.Predictor
) -> tuple[Tensor, Tensor]:
    """One pass for both teachers: audio_features [B, T, A] and the contrastive loss."""
    x, state = audio[..., None], encoder.init_state(len(audio))
    if isinstance(encoder, CentredEncoder):
        mask = contrastive.draw_mask(len(audio), audio.shape[1] // encoder.config.stride)
        mask = mask.to(audio.device)
        latents, context, _ = encoder.hidden(x, state, (mask, predictor.mask))
        loss = contrastive.masked_loss(latents, context, mask, predictor)
    else:
        latents, context, _ = encoder.hidden(x, state)
        loss = contrastive.future_loss(latents, context, predictor)
    return _stack(encoder, encoder.project(context)), loss


def draw_batch(
    groups: dict[str, list[Clip]], config: AudioConfig, rng: np.random.Generator
) -> tuple[list[Crop], list[str]]:
    names = [name for name, _ in config.shares if groups.get(name)]
    share = np.array([value for name, value in config.shares if name in names])
    truths = [str(t) for t in rng.choice(names, config.batch, p=share / share.sum())]
    clips = [pick(groups[truth], truth, rng) for truth in truths]
    return [crop(clip, config.frames, rng) for clip in clips], truths


def pick(clips: list[Clip], truth: str, rng: np.random.Generator) -> Clip:
    """A random clip. Tracked ones by voice first, as the root of how many clips it has: nearly all
    are of one speaker, and it is other voices that are hard."""
    if truth == "tracked":
        voices, counts = np.unique([clip.voice for clip in clips], return_counts=True)
        share = np.sqrt(counts) / np.sqrt(counts).sum()
        voice = rng.choice(voices, p=share)
        clips = [clip for clip in clips if clip.voice == voice]
    return clips[rng.integers(len(clips))]


def grouped(pack: Path, split: str) -> dict[str, list[Clip]]:
    """The clips of a split by their kind of truth."""
    groups: dict[str, list[Clip]] = {}
    for clip in read_pack(pack, split):
        groups.setdefault(clip.truth, []).append(clip)
    return groups


def run(config: AudioConfig) -> dict[str, float]:
    """Train and write the encoder with its card; returns the smoothed losses."""
    ranks = parallel.join(config.run.device)
    torch.manual_seed(config.run.seed)
    groups = grouped(config.pack, "train")
    encoder = (CentredEncoder if config.centred else AudioEncoder)(config.encoder)
    width = encoder.config.width * PACK_SAMPLES_PER_FRAME // encoder.config.stride
    heads, predictor = Heads(width), contrastive.Predictor(config.encoder.layers[-1][0])
    if config.start is not None:
        _start_from(config.start, config, encoder, heads)
    modules: dict[str, nn.Module] = {"encoder": encoder, "heads": heads, "predictor": predictor}
    for module in modules.values():
        module.to(config.run.device).train()
    filters = mel_filters().to(config.run.device)
    forward = torch.compile(contrasted) if config.run.compile else contrasted

    def step_losses(step: int, rng: np.random.Generator) -> dict[str, Tensor]:
        crops, truths = draw_batch(groups, config, rng)
        audio = torch.tensor(np.stack([c.audio for c in crops]), device=filters.device)
        if not config.contrastive_weight:
            return losses(heads(stacked(encoder, audio)), crops, truths, filters)
        features, contrast = forward(encoder, audio, predictor)
        result = losses(heads(features), crops, truths, filters)
        result["contrastive"] = contrast
        result["total"] = result["total"] + config.contrastive_weight * contrast
        return result

    metrics, curve = loop.train(
        "audio", modules, step_losses, steps=config.steps, rate=config.rate, run=config.run
    )
    if ranks.leads:
        write(config, encoder, heads, config.run.card(metrics, curve))
    parallel.wait(ranks)
    return metrics


def _start_from(path: Path, config: AudioConfig, encoder: AudioEncoder, heads: Heads) -> None:
    old = load_encoder(path)
    if old.config != config.encoder or isinstance(old, CentredEncoder) != config.centred:
        raise InputError(
            f"--start {path}: expected an encoder of the same config, got another; "
            "leave --start away or choose its preset"
        )
    encoder.load_state_dict(old.state_dict())
    if config.heads.with_suffix(".json").is_file():
        heads.load_state_dict(load_heads(config.heads).state_dict())


def write(
    config: AudioConfig, encoder: AudioEncoder, heads: Heads, trained: dict[str, Any]
) -> None:
    """Encoder to `config.output`; its heads to `config.heads`, for making labels of real voices."""
    card = {
        "kind": "centred" if config.centred else "audio",
        "config": asdict(config.encoder),
        "data": read_manifest(config.pack)["sources"],
        "truth": "mouth curves: made by rules, by a face tracker (GRID), or by loudness (jaw only)",
        "steps": config.steps,
        **trained,
    }
    checkpoint.save(config.output, checkpoint.quantised(encoder.state_dict()), card)
    width = heads.norm.weight.shape[0]
    card = {"kind": "heads", "config": {"width": width}}
    checkpoint.save(config.heads, loop.halved(heads.state_dict()), card)


def preset(name: str, **settings: Any) -> AudioConfig:
    return replace(AudioConfig(**settings), **PRESETS[name])


def load_encoder(path: Path) -> AudioEncoder:
    """An encoder of either kind, with weights in full precision."""
    tensors, card = checkpoint.load(path, "audio", "centred")
    config = checkpoint.config_from(AudioEncoderConfig, card["config"])
    encoder = (CentredEncoder if card["kind"] == "centred" else AudioEncoder)(config)
    encoder.load_state_dict(
        {k: v.float() if v.is_floating_point() else v for k, v in tensors.items()}
    )
    return encoder.eval()
