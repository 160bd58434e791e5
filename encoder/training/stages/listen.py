"""Stage "listen": a trained chain hears phones beside what it heard, and moves its mouth by both.

After `audio`. Nothing of the chain is trained again: eyes, lids, brows and emotions stay. The
direct path from phones to the mouth (encoder/denoiser/direct.py) is a least squares fit to tracked
motion, and says half of the mouth; the blocks say the other half. Two that err differently err less
together.
"""

import shutil
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor
from tqdm import tqdm

from encoder.audio.config import SECOND, AudioEncoderConfig
from encoder.audio.encoder import AudioEncoder
from encoder.capture.dataset import Clip, iter_pack, read_manifest
from encoder.denoiser.config import HEAD, DenoiserConfig
from encoder.inference import STUDENTS, load_student
from encoder.nn import checkpoint
from encoder.training.checkpoints import load_encoder
from encoder.training.clips import stacked
from encoder.training.geometry import TrainingFace
from encoder.training.presets import Presets
from encoder.training.stages.diffusion import TRUTH
from encoder.training.streams.augment import crop
from encoder.training.streams.streams import warped
from encoder.types import Weights
from sensors.types import InputError

CLEAN = 0.25  # share of clips as a good microphone hears them
LONGEST = 300  # frames of a clip
CHUNK = 20_000  # frames
FITTED = ("share", "gain", "rules", "rest", "ridge", "versions")
RULES, REST = "", "-"  # who shows rule-made motion, or none


@dataclass(frozen=True, kw_only=True)
class ListenConfig:
    pack: Path
    phones: Path  # the phonetic encoder, without suffix
    old: Path  # folder of the chain that learns to hear phones
    pair: Path  # where the old encoder and the phonetic one are written as one
    output: Path  # folder of the student
    seed: int = 0
    note: tuple[tuple[str, str], ...] = ()
    without: tuple[str, ...] = ()  # talkers whose tracked motion is left out
    # of the mouth that the blocks' is; measured on talkers left out (r raw, above 0.5 Hz): 1 .74
    # .56, .7 .76 .60, .5 .76 .62, .3 .76 .63, 0 .74 .60; the more, the nearer to rule-made motion
    share: float = 0.6
    gain: float = 1.1  # of both: a mean of guesses moves less than people do
    rules: float = 0.2  # weight of rule-made motion, against 1 of real talkers, who lose r by it
    rest: float = 1.0  # weight of lips at rest: at .2 a fan moves them by 1.5 mm, at 1 by 1.1
    ridge: float = 3e-3
    versions: int = 2  # of each clip, each heard by other ears; of a rare talker's four times that


preset = Presets(
    ListenConfig,
    {"debug": {"versions": 1}, "default": {}, "paper": {"versions": 10}},
)


@dataclass(frozen=True)
class ListenFrames:
    """What was heard of each frame, what the mouth did and whose it was."""

    sound: np.ndarray  # [N, D] float16 audio features of the phonetic encoder
    rig: np.ndarray  # [N, 53] float16
    voice: np.ndarray  # [N] str, the talker's, RULES or REST


def hear(config: ListenConfig, encoder: AudioEncoder) -> ListenFrames:
    """Each clip from its start, as other ears and rooms hear it; kept in the pack for next time."""
    path = config.pack / "heard.npz"
    sha256 = checkpoint.load(config.phones, "audio")[1]["sha256"]
    recipe = np.array(f"{sha256} {config.seed} {config.versions}")
    if path.is_file():
        with np.load(path, allow_pickle=False) as data:
            if str(data["recipe"]) == str(recipe):
                return ListenFrames(data["sound"], data["rig"], data["voice"])
    rng, rows = np.random.default_rng(config.seed), []
    truths = ("rules", "tracked", "rest")
    clips = [clip for clip in iter_pack(config.pack, "train") if clip.truth in truths]
    voices = [clip.voice for clip in clips if clip.truth == "tracked"]
    most = max((voices.count(voice) for voice in set(voices)), default=1)
    for clip in tqdm(clips, desc="clips", mininterval=2):
        rare = clip.truth == "tracked" and voices.count(clip.voice) < most / 4
        count = 4 * config.versions if rare else config.versions
        rows += [_heard(clip, encoder, rng) for _ in range(1 if clip.truth == "rules" else count)]
    heard = ListenFrames(*(np.concatenate(parts) for parts in zip(*rows, strict=True)))
    np.savez(path, recipe=recipe, sound=heard.sound, rig=heard.rig, voice=heard.voice)
    return heard


@torch.no_grad()
def _heard(
    clip: Clip, encoder: AudioEncoder, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    part = crop(clip, min(clip.num_frames, LONGEST), rng, 0.0 if rng.random() < CLEAN else 0.3)
    sound = stacked(warped(encoder, rng), torch.from_numpy(part.audio)[None])[0]
    voice = {"rules": RULES, "rest": REST}.get(clip.truth, clip.voice)
    return sound.half().numpy(), part.rig.astype(np.float16), np.full(len(part.rig), voice)


def frame_weights(voice: np.ndarray, config: ListenConfig) -> np.ndarray:
    """[N]: a talker counts as the root of how much there is; those left out, not at all."""
    weight = np.zeros(len(voice))
    for name in sorted(set(voice.tolist()) - {RULES, REST, *config.without}):
        weight[voice == name] = 1 / np.sqrt((voice == name).sum())
    weight /= max(weight.sum(), 1e-9)
    for name, share in ((RULES, config.rules), (REST, config.rest)):
        weight[voice == name] = share / max((voice == name).sum(), 1)
    return weight / weight.sum()


def fit(
    heard: ListenFrames, face: TrainingFace, config: ListenConfig
) -> tuple[np.ndarray, np.ndarray]:
    """-> matrix [2 D, 256], offset [256]: codes of the mouth from log-odds and their sigmoids."""
    for talker in config.without:
        if talker not in heard.voice:
            known = ", ".join(sorted(set(heard.voice.tolist()) - {RULES, REST}))
            raise InputError(f"--leave-out: expected one of {known}, got {talker!r}")
    weight = frame_weights(heard.voice, config)
    moments: Any = 0
    for part in np.array_split(np.flatnonzero(weight), max(len(weight) // CHUNK, 1)):
        sound = torch.from_numpy(heard.sound[part]).float()
        codes = torch.from_numpy(face.rig_to_code(heard.rig[part].astype(np.float32))).float()
        one = torch.ones(len(part), 1)
        x = torch.cat([sound, sound.sigmoid(), one, face.mouth(codes)], -1).numpy()
        moments = moments + ((x * weight[part, None].astype(np.float32)).T @ x).astype(np.float64)
    inputs = 2 * heard.sound.shape[1]
    mean = moments[inputs]  # of inputs, 1 and codes
    moments = moments - np.outer(mean, mean)
    gram, cross = moments[:inputs, :inputs], moments[:inputs, inputs + 1 :]
    spread = np.sqrt(np.diag(gram).clip(0)) + 1e-3
    gram = gram / np.outer(spread, spread) + config.ridge * np.eye(inputs)
    matrix = np.linalg.solve(gram, cross / spread[:, None]) / spread[:, None]
    return matrix, mean[inputs + 1 :] - mean[:inputs] @ matrix


def listening(
    sizes: DenoiserConfig, weights: Weights, face: TrainingFace,
    matrix: np.ndarray, offset: np.ndarray, config: ListenConfig,
) -> tuple[DenoiserConfig, Weights]:  # fmt: skip
    """A student with the direct path: share * gain of its own mouth, the rest of the fit's."""
    std, mean = (torch.from_numpy(weights[f"expression_{name}"]) for name in ("std", "mean"))
    heard = len(matrix) // 2
    result = {name: array for name, array in weights.items() if not name.startswith(HEAD)}

    def standard(codes: Tensor) -> np.ndarray:
        return (face.mouth(codes) / std).float().numpy()

    own, fitted = config.share * config.gain, (1 - config.share) * config.gain
    for name in ("output.weight", "output.bias"):
        rows = np.moveaxis(weights[name], 0, -1)
        mouth = standard(torch.from_numpy(np.ascontiguousarray(rows)) * std)
        result[name] = np.moveaxis(rows - np.float32(1 - own) * mouth, -1, 0)
    # what is shown is own * (blocks + mean) + fitted * fit, of which the mean comes by itself
    rest = torch.from_numpy(fitted * offset).float() - (1 - own) * face.mouth(mean)
    result["direct.move.weight"] = standard(torch.from_numpy(fitted * matrix).float()).T.copy()
    result["direct.move.bias"] = standard(rest)
    nothing = np.zeros(heard, np.float32)
    result["null_audio"] = np.concatenate([weights["null_audio"], nothing])
    sizes = replace(sizes, audio_dim=sizes.audio_dim + heard, direct_dim=heard, contact=0)
    return sizes, result


def run(config: ListenConfig, face: TrainingFace) -> None:
    """Fit and write the chain: encoder, student and what extends it; of talkers left out, the
    student alone."""
    phones = load_encoder(config.phones)
    matrix, offset = fit(hear(config, phones), face, config)
    sizes, weights, card = load_student(config.old, "gaze")
    sizes, weights = listening(sizes, weights, face, matrix, offset, config)
    sha256 = _write_encoder(config, phones)
    kept = {k: card[k] for k in ("teacher", "guidance", "steps", "seed", "history") if k in card}
    facts = {
        "audio_sha256": sha256,
        "blocks": card["sha256"],
        "truth": TRUTH,
        "data": {**card.get("data", {}), **read_manifest(config.pack)["sources"]},
        "direct": {
            k: getattr(config, k) for k in ("share", "gain", "rules", "rest", "ridge", "versions")
        },
        "without": config.without,
        **kept,
        **dict(config.note),
    }
    path = config.output / STUDENTS["gaze"]
    _save(path, weights, {"kind": "student", "config": asdict(sizes), **facts})
    if config.without:
        return
    sha = {"sha256": checkpoint.load(path, "student")[1]["sha256"]}
    own, card = checkpoint.load(config.old / STUDENTS["eyes"], "student")
    sizes, weights, _ = load_student(config.old, "eyes")
    sizes, weights = listening(sizes, weights, face, matrix, offset, config)
    card |= {"config": asdict(sizes), "audio_model": card["audio_model"] | sha}
    card["audio_sha256"] = sha256
    _save(config.output / STUDENTS["eyes"], {k: v for k, v in weights.items() if k in own}, card)
    for path in config.old.glob("eyes.*"):
        shutil.copy(path, config.output)
    zero, card = checkpoint.load(config.old / "emotion", "emotion")
    zero = {k: v.astype(np.float16) if v.ndim > 1 else v for k, v in zero.items()}
    card["student_sha256"] = sha["sha256"]
    checkpoint.save(config.output / "emotion", zero, card)


def _save(path: Path, weights: Weights, card: dict[str, Any]) -> None:
    checkpoint.save(path, checkpoint.quantised(weights), card)


def _write_encoder(config: ListenConfig, phones: AudioEncoder) -> str:
    """The old encoder and the phonetic one as a pair -> its sha256."""
    weights, card = checkpoint.load(config.old / "audio", "audio")
    theirs, about = checkpoint.load(config.phones, "audio")
    sizes = checkpoint.config_from(AudioEncoderConfig, card["config"])
    if sizes.second:
        raise InputError(
            f"--start {config.old}: expected a chain that hears no phones yet, got one that does; "
            "give the folder it was made from"
        )
    pair = replace(sizes, second=phones.config)
    both = weights | {SECOND + name: array for name, array in theirs.items()}
    card |= {"config": asdict(pair), "second": {k: v for k, v in about.items() if k != "config"}}
    if not config.without:
        _save(config.pair, both, card)
    return checkpoint.load(config.pair, "audio")[1]["sha256"]
