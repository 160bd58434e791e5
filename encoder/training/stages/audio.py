"""Stage 1: train the audio encoder (paper section 4.3 uses wav2vec; none is public here).

Its output describes what is said, whoever speaks and whatever the room: log-odds of phone and
viseme, of the viseme that comes next, voicing, pitch and loudness. Phones come from text (aligned,
or exact from synthesis); visemes of voices without text come from a small public network, which
hears the clean sound.
"""

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from encoder.audio.config import PRESETS as ENCODERS
from encoder.audio.config import AudioEncoderConfig
from encoder.audio.encoder import AudioEncoder
from encoder.capture.dataset import PACK_RATE, iter_pack, read_manifest
from encoder.capture.speech.phones import PHONES
from encoder.nn import checkpoint
from encoder.training import loop, parallel, viseme_teacher
from encoder.training.centred import CentredEncoder
from encoder.training.checkpoints import load_encoder
from encoder.training.presets import Presets
from encoder.training.streams import ears, heard
from sensors.types import InputError

SETTLE = 30  # features at the start of a crop without a loss: the encoder has no past there
# phones, visemes, visemes that come next, voiced, pitch, loudness
WIDTH = len(PHONES) + 2 * len(viseme_teacher.VISEMES) + 3
# Talkers whose tracked motion tests all later stages: the encoder never hears their voices.
TALKERS = ("grid-", "facegood")
AHEAD_S = round(heard.AHEAD * heard.HOP / PACK_RATE, 4)
KNOWN = "grid-s1"  # the exception, who is in every training set


@dataclass(frozen=True, kw_only=True)
class AudioConfig:
    pack: Path
    output: Path  # without suffix: .safetensors and .json are added
    run: loop.RunSettings
    teacher: Path | None = (
        None  # the viseme network's ONNX file; None: train on voices with text only
    )
    start: Path | None = None  # an audio checkpoint of the same config to go on from
    encoder: AudioEncoderConfig = field(default_factory=lambda: ENCODERS["phonetic"])
    centred: bool = False  # the ablation's encoder, which sees half a second ahead
    steps: int = 1600
    batch: int = 12
    count: int = 360  # features of a crop
    rate: float = 2e-3
    shares: tuple[tuple[str, float], ...] = (
        ("rules", 0.45),
        ("tracked", 0.15),
        ("envelope", 0.4),  # real voices without text: the most voices
    )


preset = Presets(
    AudioConfig,
    {
        "debug": {"encoder": ENCODERS["phonetic-debug"], "steps": 2, "batch": 2, "count": 60},
        "default": {},
        "paper": {"steps": 100_000, "batch": 64, "rate": 1e-3},
    },
)


def lessons_of(config: AudioConfig) -> dict[str, list[heard.Heard]]:
    """Training clips, by kind of truth, without the talkers left out."""
    teacher = viseme_teacher.VisemeTeacher(config.teacher) if config.teacher else None
    groups: dict[str, list[heard.Heard]] = {}
    for clip in iter_pack(config.pack, "train"):
        judged = clip.voice.startswith(TALKERS) and clip.voice != KNOWN
        wanted = clip.truth in dict(config.shares) and (teacher or clip.truth != "envelope")
        if wanted and not judged:
            groups.setdefault(clip.truth, []).append(heard.prepare(clip, teacher))
    return groups


def losses(said: Tensor, lessons: list[heard.Lesson], loudness: Tensor) -> dict[str, Tensor]:
    """Losses of the output [B, N, 74] against the truth; loudness [B, N]."""
    device, phones = said.device, len(PHONES)
    said, loudness = said[:, SETTLE:], loudness[:, SETTLE:]
    names, visemes, ahead, tone = (
        torch.from_numpy(np.stack([getattr(x, name) for x in lessons]))[:, SETTLE:].to(device)
        for name in ("phones", "visemes", "ahead", "pitch")
    )
    now, after, others = said[..., phones:].split([visemes.shape[-1], ahead.shape[-1], 3], -1)
    voiced, octaves, loud = others.unbind(-1)
    odds = functional.binary_cross_entropy_with_logits
    result = {
        "phone": functional.cross_entropy(
            said[..., :phones].flatten(0, 1), names.flatten(), ignore_index=-1, label_smoothing=0.03
        ),
        "viseme": odds(now, visemes, reduction="none").sum(-1).mean(),
        "ahead": odds(after, ahead, reduction="none").sum(-1).mean(),
        "voiced": odds(voiced, tone[..., 0]),
        "pitch": ((octaves - tone[..., 1]).square() * tone[..., 0]).mean(),
        "loudness": (loud - loudness).square().mean(),
    }
    if not bool((names >= 0).any()):
        result["phone"] = said.sum() * 0
    total = sum(result.values()) - 0.5 * result["voiced"] - 0.5 * result["ahead"]
    return result | {"total": torch.as_tensor(total)}


def run(config: AudioConfig) -> dict[str, float]:
    """Train and write the encoder with its card; returns the smoothed losses."""
    if config.encoder.width != WIDTH or not config.encoder.bands:
        raise InputError(
            f"train audio: expected an encoder of spectra with {WIDTH} outputs, got "
            f"{config.encoder.kind!r} with {config.encoder.width}; use preset default"
        )
    ranks = parallel.join(config.run.device)
    torch.manual_seed(config.run.seed)
    encoder = (CentredEncoder if config.centred else AudioEncoder)(config.encoder)
    if config.start is not None:
        _start_from(config.start, config, encoder)
    encoder.to(config.run.device).train()
    groups, spectrum = lessons_of(config), encoder.spectrum
    assert spectrum is not None
    banks = ears.banks(spectrum).to(config.run.device)
    names = [name for name, _ in config.shares if groups.get(name)]
    share = np.array([value for name, value in config.shares if name in names])
    sizes = {name: np.array([len(x.audio) for x in groups[name]], float) for name in names}

    def draw(rng: np.random.Generator) -> heard.Lesson:
        name = str(rng.choice(names, p=share / share.sum()))
        place = rng.choice(len(sizes[name]), p=sizes[name] / sizes[name].sum())
        return heard.cut(groups[name][place], config.count, rng)

    def step_losses(step: int, rng: np.random.Generator) -> dict[str, Tensor]:
        lessons = heard.amid_noise([draw(rng) for _ in range(config.batch)], rng)
        noisy, clean = (
            spectrum.power(functional.pad(sound, (spectrum.config.window - heard.HOP, 0)))
            for sound in (
                torch.from_numpy(np.stack([getattr(x, name) for x in lessons])).to(banks.device)
                for name in ("noisy", "clean")
            )
        )
        bands = clean @ spectrum.bank
        level = bands.mean(-1) / ears.peaks(spectrum, bands)[..., 0].exp() / spectrum.config.floor
        loudness = ((level + 1e-4).log() + 4) / 3
        spectra = ears.augmented(noisy, spectrum, banks, rng)
        said, _ = encoder.layered(spectra, encoder.init_state(config.batch))
        return losses(encoder.project(said).float(), lessons, loudness)

    modules: dict[str, nn.Module] = {"encoder": encoder}
    metrics, curve = loop.train(
        "audio", modules, step_losses, steps=config.steps, rate=config.rate, run=config.run
    )
    if ranks.leads:
        write(config, encoder, config.run.card(metrics, curve))
    parallel.wait(ranks)
    return metrics


def _start_from(path: Path, config: AudioConfig, encoder: AudioEncoder) -> None:
    old = load_encoder(path)
    if old.config != config.encoder or isinstance(old, CentredEncoder) != config.centred:
        raise InputError(
            f"--start {path}: expected an encoder of the same config, got another; "
            "leave --start away or choose its preset"
        )
    encoder.load_state_dict(old.state_dict())


def write(config: AudioConfig, encoder: AudioEncoder, trained: dict[str, Any]) -> None:
    sources = read_manifest(config.pack)["sources"]
    if config.teacher:
        sources = {**sources, "viseme teacher": viseme_teacher.SOURCE}
    card = {
        "kind": "centred" if config.centred else "audio",
        "config": asdict(config.encoder),
        "outputs": {"phones": PHONES, "visemes": viseme_teacher.VISEMES, "ahead_s": AHEAD_S,
                    "others": "visemes ahead_s later, voiced, pitch, loudness"},
        "data": sources,
        "truth": "phones: of synthesis, or aligned with text; visemes: the same, and the teacher's",
        "steps": config.steps,
        **trained,
    }  # fmt: skip
    if config.start is not None:  # what it went on from, the last first
        began = checkpoint.load(config.start, "audio", "centred")[1]
        card["start"] = [{k: began[k] for k in ("sha256", "steps")}, *began.get("start", [])]
    checkpoint.save(config.output, checkpoint.quantised(encoder.state_dict()), card)
