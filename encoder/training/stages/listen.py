"""Stage "listen": adds the phonetic encoder to a trained chain; both move the mouth.

Runs after `audio`. The chain itself is not trained again: eyes, lids, brows and emotions stay. The
direct path (encoder/denoiser/direct.py) learns the motion of tracked mouths from phones alone, and
to tell voices from other sounds. Its mouth is mixed with that of the blocks: the two make different
errors, so the mixture has less. A new contact head is trained behind both.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from encoder.denoiser.config import MOUTH
from encoder.denoiser.contact import Contact
from encoder.denoiser.direct import Direct
from encoder.denoiser.model import Denoiser
from encoder.nn import checkpoint
from encoder.training import loop, touches
from encoder.training.checkpoints import load_encoder
from encoder.training.geometry import TrainingFace
from encoder.training.mouth import Mouth
from encoder.training.presets import Presets
from encoder.training.stages import chain
from encoder.training.stages.contact import fold_scale, new_head
from encoder.training.streams.lip_lines import LipLines
from encoder.training.streams.pieces import SpokenPieces, phone_weights
from encoder.training.streams.spoken import Ears, hear_pack

SAMPLES = 20_000  # frames that scales are measured on


@dataclass(frozen=True, kw_only=True)
class ListenConfig:
    pack: Path
    phones: Path  # the phonetic encoder, without suffix
    old: Path  # folder of the chain that learns to hear phones
    pair: Path  # where the old encoder and the phonetic one are written as one
    output: Path  # folder of the student
    run: loop.RunSettings
    without: tuple[str, ...] = ()  # talkers whose tracked motion is left out
    # of the mouth that the blocks' is; on talkers left out (r raw, above 0.5 Hz | lost to babble):
    # .25 .784 .664 | .057, .1 .783 .668 | .048, 0 .778 .665 | .044; the more, the nearer to
    # rule-made motion and to talkers whom the blocks know
    share: float = 0.1
    gain: float = 1.25  # of both: a mean of predictions moves less than people do
    width_gain: float = 1.15  # of how wide the lips are, on top
    hidden: int = 256
    contact: int = 32
    # of how far lips are apart and of how wide they are, as straight lines say it (lip_lines.py)
    lines: tuple[float, float] = (0.4, 0.75)
    # slope and offset that the log-odds of a voice get after training: in doubt lips rest
    gate: tuple[float, float] = (2.0, -1.5)
    drop: float = 0.4  # dropout: share of hidden units left out in a step
    drop_heard: float = 0.2
    steps: int = 600
    batch: int = 48
    frames: int = 100
    rate: float = 2e-3
    # how much more a rare phone weighs: power of its share; 0: r .01 lower, with babble .03
    balance: float = 0.4
    rules: float = 0.25  # weight of rule-made motion, against 1 of real talkers
    rest: float = 0.3  # weight of what is no voice
    versions: int = 2  # of each clip, each with its own random microphone and room
    noises: int = 200  # clips of no voice beside the pack's
    velocity_weight: float = 0.3
    span_weight: float = 0.6  # of the lips' opening and width
    tongue_weight: float = 1.0
    voice_weight: float = 4.0
    heard_weight: float = 1.0  # of a missed voice, in it; with 1.3 keys move lips .5 to .8 mm
    miss_weight: float = 8.0  # of lips that are not shut for p, b and m
    false_weight: float = 12.0  # of lips that are shut in what is said far from p, b and m
    loose_weight: float = 400.0  # of a lower lip that is not on the teeth for f and v
    tucked_weight: float = 100.0  # of one that is, elsewhere
    effort_weight: float = 1.0  # of what the contact head moves near p, b and m
    idle_weight: float = 8.0  # of what it moves elsewhere


preset = Presets(
    ListenConfig,
    {
        "debug": {"versions": 1, "noises": 2, "steps": 2, "batch": 2, "frames": 12, "hidden": 8},
        "default": {},
        "paper": {"versions": 10, "steps": 6000},
    },
)


@dataclass(frozen=True)
class Listener:
    """The direct path and the contact head in training, and the frozen chain before them."""

    direct: Direct
    contact: Contact
    student: Denoiser
    mouth: Mouth
    scale: tuple[Tensor, Tensor]  # mean and spread of log-odds and of their sigmoids
    lines: LipLines
    mix: Tensor  # [MOUTH, MOUTH]: gains
    rarity: Tensor  # [P + 1] weight of a frame by its phone; the last: not known

    def losses(self, batch: tuple[Tensor, ...], config: ListenConfig) -> dict[str, Tensor]:
        heard, own, truth, phones, voiced, there = batch
        seen = (torch.cat([heard, heard.sigmoid()], -1) - self.scale[0]) / self.scale[1]
        plain = seen[..., : heard.shape[-1]]
        dropped = functional.dropout(seen, config.drop_heard)
        said = self.direct.said(dropped, config.drop)
        off = self.mouth.vertices(said - truth) * there[..., None]
        spans = self.mouth.spans(said - truth) * there[..., None]
        count, rare = there.sum(), self.rarity[phones][..., None]
        result = {
            "shape": (off.square() * rare).sum() / count,
            "velocity": off.diff(dim=1).square().sum() / count,
            "span": (spans.square() * rare).sum() / count,
            "tongue": self._tongue(said - truth, phones, there),
        }
        odds = self.direct.voiced(plain)[..., 0]
        sides = [there * (voiced == side) for side in (0, 1)]
        off = functional.binary_cross_entropy_with_logits(odds, voiced.clamp(0), reduction="none")
        rest, voice = ((off * side).sum() / side.sum().clamp(min=1) for side in sides)
        result["voice"] = rest + config.heard_weight * voice
        lined = self.lines.beside(said.detach(), seen)
        mixed = config.share * own + (1 - config.share) * lined
        voice = odds.detach().sigmoid()
        shown = voice[..., None] * (mixed @ self.mix)
        x0 = self.student.standardise(self.mouth.codes(shown))
        moved = voice * self.contact.moved_mm(x0, plain)[..., 0]
        gaps = self.mouth.gap(shown) + moved, moved, self.mouth.gap(truth)
        result |= touches.meeting(*gaps, phones, there, self.rarity)
        rolls = said @ self.mouth.roll, truth @ self.mouth.roll
        result |= touches.tucking(*rolls, phones, there, self.rarity)
        total = result["shape"] + sum(
            getattr(config, f"{name}_weight") * value
            for name, value in result.items()
            if name != "shape"
        )
        return result | {"total": total}  # type: ignore[dict-item]

    def _tongue(self, error: Tensor, phones: Tensor, there: Tensor) -> Tensor:
        """Mean squared error of the raised tongue, where phones tell what it does."""
        known = there * (phones >= 0)
        off = (error @ self.mouth.tongue).square().sum(-1)
        return (off * known).sum() / known.sum().clamp(min=1)


def run(config: ListenConfig, face: TrainingFace) -> dict[str, float]:
    """Train, and write the chain: encoder, student and what extends it; with talkers left out, only
    the student."""
    old = chain.OldChain.load(config.old)
    if config.without:  # what the student is to hear with must be there before it is trained
        checkpoint.load(config.pair, "audio")
    if old.knows(config.without):
        config = replace(config, share=0.0)  # they would tell whom they have seen
    phones = load_encoder(config.phones)
    recipe = f"{checkpoint.load(config.phones, 'audio')[1]['sha256']} {old.blocks}"
    student = old.student()
    ears = Ears(phones, old.audio, student)
    frames = hear_pack(
        config.pack, ears, recipe, seed=config.run.seed, versions=config.versions,
        noises=config.noises,
    ).without(config.without)  # fmt: skip
    pieces = SpokenPieces(
        frames, Mouth.of(face), batch=config.batch, length=config.frames, rules=config.rules,
        rest=config.rest,
    )  # fmt: skip
    torch.manual_seed(config.run.seed)  # of the first weights, whoever heard the pack
    listener = new_listener(pieces, student, config)
    trained = {"direct": listener.direct, "contact": listener.contact}

    def step_losses(step: int, rng: np.random.Generator) -> dict[str, Tensor]:
        return listener.losses(pieces.draw(rng), config)

    metrics, curve = loop.train(
        "listen", trained, step_losses, steps=config.steps, rate=config.rate, run=config.run
    )
    finish(listener, config)
    names = (
        "share", "lines", "gain", "width_gain", "gate", "balance", "rules", "rest", "versions",
        "noises", "steps",
    )  # fmt: skip
    facts = {name: getattr(config, name) for name in names}
    facts |= {"without": config.without, **config.run.card(metrics, curve)}
    places = chain.ChainPaths(config.pack, config.phones, config.pair, config.output)
    chain.write(old, places, listener.direct, listener.contact, facts, whole=not config.without)
    return metrics


def new_listener(pieces: SpokenPieces, student: Denoiser, config: ListenConfig) -> Listener:
    """An untrained Listener, which changes nothing."""
    mouth = pieces.mouth
    every = max(len(pieces.frames.heard) // SAMPLES, 1)
    heard = torch.from_numpy(pieces.frames.heard[::every].astype(np.float32))
    seen = torch.cat([heard, heard.sigmoid()], -1)
    scale = seen.mean(0), seen.std(0) + 1e-2
    direct = Direct(heard.shape[1], student.config.expression_dim, config.hidden)
    contact = new_head(student, mouth.face, config.contact, heard.shape[1])
    mix = config.gain * mouth.widened(torch.from_numpy(pieces.truth[::every]), config.width_gain)
    rarity = torch.from_numpy(phone_weights(pieces.frames.phones, config.balance))
    lines = LipLines.of(pieces, scale, config.lines)
    return Listener(direct, contact, student, mouth, scale, lines, mix, rarity)


@torch.no_grad()
def finish(listener: Listener, config: ListenConfig) -> None:
    """In place: turn heads trained on standardised features and the mouth's numbers into the
    student's."""
    direct, (mean, spread) = listener.direct, listener.scale
    dim = direct.hear.in_features
    listener.lines.fold(direct)
    for layer in (direct.listen, direct.straight):
        fold_scale(layer, mean, spread)
    for layer in (direct.hear, listener.contact.listen):
        fold_scale(layer, mean[:dim], spread[:dim])
    slope, offset = config.gate
    direct.voice.weight.mul_(slope)
    direct.voice.bias.mul_(slope).add_(offset)
    mix = (1 - config.share) * listener.mix
    for layer in (direct.move, direct.straight):
        layer.weight.copy_(mix.T @ layer.weight)
        layer.bias.copy_(mix.T @ layer.bias)
    student = listener.student
    read, write = (torch.from_numpy(a) for a in (listener.mouth.read, listener.mouth.write))
    direct.read.copy_(student.expression_std[:, None] * read)
    direct.rest.copy_(student.expression_mean @ read)
    direct.write.copy_(write / student.expression_std)
    direct.share.copy_(config.share * listener.mix)
    assert direct.share.shape == (MOUTH, MOUTH)
