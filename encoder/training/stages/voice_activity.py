"""Stage "voice-activity": what hears voices learns further sounds that are none.

Runs after `listen`. Where people may talk, the student's own probability of a voice is the target,
so that mouths go on as before; everywhere else it is 0. Only the two layers of the direct path
that hear voices are trained.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional
from tqdm import tqdm

from encoder.audio.encoder import AudioEncoder
from encoder.capture.dataset import PACK_SAMPLES_PER_FRAME, Clip, iter_pack
from encoder.capture.speech.handling import wind
from encoder.capture.speech.voice_like import VOICE_LIKE, played
from encoder.denoiser.direct import Direct
from encoder.denoiser.model import Denoiser
from encoder.inference import STUDENTS, load_student
from encoder.nn import checkpoint
from encoder.nn.modules import fill
from encoder.training import loop
from encoder.training.checkpoints import load_encoder
from encoder.training.clips import keep, kept, stacked
from encoder.training.presets import Presets
from encoder.training.stages import chain
from encoder.training.stages.contact import fold_scale
from encoder.training.streams.augment import NOT_SPEECH, Crowd, crop, not_speech
from encoder.training.streams.streams import check_left_out
from sensors.types import InputError

FRAMES = 300  # of a crop
PLAIN = 0.5  # share of the clips that are heard as they are
OTHERS_DB = (6, 26)  # that other voices are below a talker
KINDS = (*NOT_SPEECH, *[wind] * 6, *VOICE_LIKE, *VOICE_LIKE, *[played] * 8)  # equally many of each
AT_ONCE = 20_000  # frames


@dataclass(frozen=True)
class HeardFrames:
    """Frames of crops, end to end."""

    heard: np.ndarray  # [N, D] float16 log-odds of the phonetic encoder


@dataclass(frozen=True, kw_only=True)
class VoiceActivityConfig:
    pack: Path
    audio: Path  # the audio encoder, without suffix
    chain: Path  # folder of the student that is trained further
    output: Path
    run: loop.RunSettings
    without: tuple[str, ...] = ()  # talkers who are not heard
    people: int = 1200  # crops of 10 s
    sounds: int = 2400  # the same without a voice
    steps: int = 6000
    batch: int = 1500  # frames of each
    rate: float = 1e-3
    drop: float = 0.1  # dropout: share of what is heard that is left out in a step
    # voices lost | sounds taken for some: 1 .0055 | .0020, .5 .0039 | .0032 after 1500 steps;
    # .5 .0030 | .0020 after 4000; 1 .0034 | .0010 after 6000
    sounds_weight: float = 1.0


preset = Presets(
    VoiceActivityConfig,
    {"debug": {"people": 2, "sounds": 2, "steps": 2, "batch": 8}, "default": {}, "paper": {}},
)


def run(config: VoiceActivityConfig) -> dict[str, float]:
    """Train, and write the student and what extends it; with talkers left out, only the student."""
    sizes, weights, _ = load_student(config.chain, "gaze")
    path = config.chain / STUDENTS["gaze"]
    phones = load_encoder(config.audio).second
    if phones is None or not sizes.direct:
        raise InputError(
            f"train voice-activity: expected a student that hears phones in {config.chain}, got "
            "one that does not; run `livedrive train listen` first"
        )
    direct = fill(Denoiser(sizes), weights, path, "student").direct
    assert isinstance(direct, Direct)
    if not config.without:
        chain.check_whole(config.chain)
    recipe = f"{checkpoint.load(config.audio, 'audio')[1]['sha256']} {config.run.seed}"
    people = hear(
        config.pack / "activity_people.npz", f"{recipe} {' '.join(config.without)} {config.people}",
        people_of(config), config.people, phones, resumed=config.run.resume,
    )  # fmt: skip
    sounds = hear(
        config.pack / "activity_sounds.npz", f"{recipe} {config.people} {config.sounds}",
        sounds_of(config), config.sounds, phones, resumed=config.run.resume,
    )  # fmt: skip
    metrics, curve = train(direct, people, sounds, config)
    facts = {"without": config.without, **config.run.card(metrics, curve)}
    chain.write_voice_activity(config.chain, config.output, direct, facts, whole=not config.without)
    return metrics


def hear(
    path: Path,
    recipe: str,
    crops: Iterable[np.ndarray],
    count: int,
    phones: AudioEncoder,
    *,
    resumed: bool,
) -> np.ndarray:  # [N, D] float16
    """What the phonetic encoder makes of sounds [800 T]; kept at `path` for the same recipe.

    Raises InputError where a run that is resumed finds what another one heard."""
    if (before := kept(path, recipe, HeardFrames, resumed=resumed)) is not None:
        return before.heard
    rows = list[np.ndarray]()
    for sound in tqdm(crops, path.stem, count, mininterval=2):
        with torch.no_grad():
            rows.append(stacked(phones, torch.from_numpy(sound)[None])[0].numpy())
    frames = HeardFrames(np.concatenate(rows).astype(np.float16))
    keep(path, recipe, frames)
    return frames.heard


def people_of(config: VoiceActivityConfig) -> Iterator[np.ndarray]:
    """Crops [800 T] float32 in which somebody may talk: each voice as often as any other."""
    voices: dict[str, list[Clip]] = {}
    for clip in iter_pack(config.pack, "train"):
        if clip.truth != "rest":
            voices.setdefault(clip.voice, []).append(clip)
    check_left_out(config.without, sorted(voices))
    clips = [some for voice, some in voices.items() if voice not in config.without]
    if not clips:
        raise InputError(
            f"{config.pack}: expected clips of people, got none; run `livedrive capture`"
        )
    crowd = Crowd([clip.audio for some in clips for clip in some])
    for index in range(config.people):
        rng = np.random.default_rng([config.run.seed, index])
        some = clips[rng.integers(len(clips))]
        plain = rng.random() < PLAIN
        others = None if plain else crowd.talk
        clip = some[rng.integers(len(some))]
        length = min(clip.num_frames, FRAMES)
        yield crop(clip, length, rng, 0.0 if plain else 0.3, others, OTHERS_DB).audio


def sounds_of(config: VoiceActivityConfig) -> Iterator[np.ndarray]:
    """Crops [800 T] float32 without a voice."""
    for index in range(config.people, config.people + config.sounds):
        rng = np.random.default_rng([config.run.seed, index])
        yield not_speech(FRAMES * PACK_SAMPLES_PER_FRAME, rng, KINDS)


def train(
    direct: Direct,
    people: np.ndarray,  # [N, D] heard where somebody may talk
    sounds: np.ndarray,  # [M, D] and where nobody does
    config: VoiceActivityConfig,
) -> tuple[dict[str, float], loop.Curve]:
    """In place."""
    wanted = voiced(direct, people)
    some = torch.from_numpy(
        np.concatenate([heard[:: max(len(heard) // AT_ONCE, 1)] for heard in (people, sounds)])
    ).float()
    mean, spread = some.mean(0), some.std(0) + 1e-2
    _standardise(direct.hear, mean, spread)

    def loss(heard: np.ndarray, target: np.ndarray) -> Tensor:
        seen = (torch.from_numpy(heard.astype(np.float32)) - mean) / spread
        odds = direct.voiced(functional.dropout(seen, config.drop))[:, 0]
        return functional.binary_cross_entropy_with_logits(odds, torch.from_numpy(target))

    def step_losses(step: int, rng: np.random.Generator) -> loop.Losses:
        chosen, others = (rng.integers(len(heard), size=config.batch) for heard in (people, sounds))
        losses = {
            "people": loss(people[chosen], wanted[chosen]),
            "sounds": loss(sounds[others], np.zeros(config.batch, np.float32)),
        }
        return losses | {"total": losses["people"] + config.sounds_weight * losses["sounds"]}

    modules: dict[str, nn.Module] = {"hear": direct.hear, "voice": direct.voice}
    metrics, curve = loop.train(
        "voice activity", modules, step_losses, steps=config.steps, rate=config.rate,
        run=config.run,
    )  # fmt: skip
    with torch.no_grad():
        fold_scale(direct.hear, mean, spread)
    lost = (voiced(direct, people)[wanted > 0.5] < 0.5).sum() / max((wanted > 0.5).sum(), 1)
    taken = (voiced(direct, sounds) > 0.5).mean()
    return {**metrics, "voices_lost": float(lost), "sounds_as_voices": float(taken)}, curve


@torch.no_grad()
def voiced(direct: Direct, heard: np.ndarray) -> np.ndarray:  # [N, D] -> [N] 0..1
    """Probability of a voice."""
    parts = [
        direct.voiced(torch.from_numpy(heard[i : i + AT_ONCE].astype(np.float32))).sigmoid()
        for i in range(0, len(heard), AT_ONCE)
    ]
    return torch.cat(parts)[:, 0].numpy()


@torch.no_grad()
def _standardise(layer: nn.Linear, mean: Tensor, spread: Tensor) -> None:
    """In place: for inputs less their mean, over their spread; `fold_scale` turns it back."""
    layer.bias.add_(layer.weight @ mean)
    layer.weight.mul_(spread)
