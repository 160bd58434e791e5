"""Stage "listen": adds the phonetic encoder to a trained chain; both move the mouth.

Runs after `audio`. The chain itself is not trained again: eyes, lids, brows and emotions stay. The
direct path (encoder/denoiser/direct.py) learns the motion of tracked mouths from phones alone, and
to tell voices from other sounds. Its mouth is mixed with that of the blocks: the two make different
errors, so the mixture has less. A new contact head is trained behind both.

Mouth, what hears voices, and contact head are trained one after another, each alone: in one loop,
with one limit on all gradients, the mouth fits less well, the head learns behind a mouth that
dropout disturbs, and what hears voices takes keys for one.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import torch

from encoder.nn import checkpoint
from encoder.training import loop
from encoder.training.checkpoints import load_encoder
from encoder.training.geometry import TrainingFace
from encoder.training.mouth import Mouth
from encoder.training.presets import Presets
from encoder.training.stages import chain
from encoder.training.stages.listen_config import ListenConfig
from encoder.training.stages.listener import Batch, Listener, closures, finish, new_listener
from encoder.training.streams.pieces import SpokenPieces
from encoder.training.streams.spoken import Ears, hear_among, hear_pack

PartLosses = Callable[[Batch, ListenConfig], loop.Losses]

preset = Presets(
    ListenConfig,
    {
        "debug": {
            "versions": 1, "noises": 2, "steps": 2, "voice_steps": 2, "contact_steps": 2,
            "batch": 2, "frames": 12, "hidden": 8,
        },
        "default": {},
        "paper": {"versions": 10, "steps": 6000},
    },
)  # fmt: skip


def run(config: ListenConfig, face: TrainingFace) -> dict[str, float]:
    """Train, and write the chain: encoder, student and what extends it; with talkers left out, only
    the student."""
    old = chain.OldChain.load(config.old)
    if config.without:  # what the student is to hear with must be there before it is trained
        checkpoint.load(config.pair, "audio")
    else:
        chain.check_whole(config.old)
    if old.knows(config.without):
        config = replace(config, shares=(0.0, 0.0, 0.0))  # they would tell whom they have seen
    phones = load_encoder(config.phones)
    recipe = f"{checkpoint.load(config.phones, 'audio')[1]['sha256']} {old.blocks}"
    student = old.student()
    ears = Ears(phones, old.audio, student)
    frames = hear_pack(
        config.pack, ears, recipe, seed=config.run.seed, versions=config.versions,
        noises=config.noises, resumed=config.run.resume,
    )  # fmt: skip
    among = hear_among(config.pack, ears, recipe, seed=config.run.seed, resumed=config.run.resume)
    pieces, voices = (
        SpokenPieces(
            part.without(config.without), Mouth.of(face), batch=config.batch, length=config.frames,
            rules=rules, rest=config.rest,
        )
        for part, rules in (
            (frames, config.rules),
            (frames.followed_by(among) if among else frames, config.voice_rules),
        )
    )  # fmt: skip
    torch.manual_seed(config.run.seed)  # of the first weights, whoever heard the pack
    listener = new_listener(pieces, student, config)
    metrics, curve = train(listener, pieces, voices, config)
    finish(listener, config, closures(phones.config, listener.direct.hear.in_features))
    names = (
        "shares", "lines", "gain", "width_gain", "gate", "balance", "rules",
        "voice_rules", "rest", "versions", "noises", "steps", "voice_steps", "contact_steps",
    )  # fmt: skip
    facts = {name: getattr(config, name) for name in names}
    facts |= {"without": config.without, **config.run.card(metrics, curve)}
    places = chain.ChainPaths(config.pack, config.phones, config.pair, config.output)
    chain.write(old, places, listener.direct, listener.contact, facts, whole=not config.without)
    return metrics


def train(
    listener: Listener, pieces: SpokenPieces, voices: SpokenPieces, config: ListenConfig
) -> tuple[dict[str, float], loop.Curve]:
    """In place: mouth, what hears voices (from `voices`), and the contact head behind both, each
    alone, each with a state of its own. Returns the metrics of all and the curve of the mouth."""
    run, modules = config.run, listener.parts
    names = "voice", "contact"
    if not run.resume or loop.steps_done(run) < config.steps:  # what is there is of another mouth
        for name in names:
            run.followed_by(name).file.unlink(missing_ok=True)
    later = [run.followed_by(name) for name in names]

    def trained(
        name: str,
        losses: PartLosses,
        steps: int,
        rate: float,
        run: loop.RunSettings,
        pieces: SpokenPieces = pieces,
    ) -> tuple[dict[str, float], loop.Curve]:
        def step_losses(step: int, rng: np.random.Generator) -> loop.Losses:
            return losses(pieces.draw(rng), config)

        return loop.train(
            f"listen: {name}", modules[name], step_losses, steps=steps, rate=rate, run=run
        )

    mouth, curve = trained("mouth", listener.mouth_losses, config.steps, config.rate, run)
    voice, _ = trained(
        "voice", listener.voice_losses, config.voice_steps, config.voice_rate, later[0], voices
    )
    contact, _ = trained(
        "contact", listener.contact_losses, config.contact_steps, config.contact_rate, later[1]
    )
    return contact | voice | mouth, curve
