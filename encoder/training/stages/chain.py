"""Reads a shipped chain of networks, and writes it extended by the phonetic encoder."""

import shutil
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from encoder.audio.config import SECOND, AudioEncoderConfig
from encoder.audio.encoder import AudioEncoder
from encoder.capture.dataset import read_manifest
from encoder.denoiser.config import HEAD, DenoiserConfig
from encoder.denoiser.contact import Contact
from encoder.denoiser.direct import Direct
from encoder.denoiser.model import Denoiser
from encoder.inference import STUDENTS, load_student
from encoder.nn import checkpoint
from encoder.nn.modules import fill
from encoder.training.checkpoints import load_encoder
from encoder.training.stages.diffusion import TRUTH
from encoder.types import Condition, Weights

DIRECT = "direct."  # how the names of the direct path's tensors begin
TALKERS = "blocks_talkers"  # in a student's card: whose motion its blocks learned from


@dataclass(frozen=True)
class OldChain:
    """A chain without the phonetic encoder and the direct path, even if its folder holds them."""

    folder: Path
    sizes: DenoiserConfig
    weights: Weights
    card: dict[str, Any]
    audio: AudioEncoder

    @staticmethod
    def load(folder: Path, condition: Condition = "gaze") -> "OldChain":
        sizes, weights, card = load_student(folder, condition)
        plain = {k: v for k, v in weights.items() if not k.startswith((HEAD, DIRECT))}
        size = sizes.audio_dim - sizes.direct_dim
        plain["null_audio"] = plain["null_audio"][:size]
        sizes = replace(sizes, audio_dim=size, direct_dim=0, direct=0, contact=0)
        encoder = load_encoder(folder / "audio")
        encoder.second, encoder.config = None, replace(encoder.config, second=None)
        return OldChain(folder, sizes, plain, card, encoder)

    @property
    def blocks(self) -> str:
        """The sha256 of the student whose blocks these are."""
        return str(self.card.get("blocks", self.card["sha256"]))

    def knows(self, talkers: tuple[str, ...]) -> bool:
        """Did the blocks learn from the motion of one of them?"""
        return bool(set(talkers) & set(self.card.get(TALKERS, ())))

    def student(self) -> Denoiser:
        path = self.folder / STUDENTS[self.sizes.condition]
        return fill(Denoiser(self.sizes), self.weights, path, "student").requires_grad_(False)


def check_whole(folder: Path) -> None:
    """Raise InputError unless what extends the student, and is written with it, is there: the
    student that sees and the emotions."""
    load_student(folder, "eyes")
    checkpoint.load(folder / "emotion", "emotion")


def listening(old: OldChain, direct: Direct, contact: Contact) -> tuple[DenoiserConfig, Weights]:
    """The student with a new direct path and contact head; all other tensors unchanged."""
    heard, hidden = direct.hear.in_features, direct.listen.out_features
    result = dict(old.weights)
    result |= {DIRECT + k: v for k, v in checkpoint.arrays(direct.state_dict()).items()}
    result |= {HEAD + k: v for k, v in checkpoint.arrays(contact.state_dict()).items()}
    result["null_audio"] = np.concatenate([old.weights["null_audio"], np.zeros(heard, np.float32)])
    size = old.sizes.audio_dim + heard
    sizes = replace(
        old.sizes,
        audio_dim=size,
        direct_dim=heard,
        direct=hidden,
        contact=contact.listen.out_features,
        reach_mm=contact.reach_mm,
    )
    return sizes, result


@dataclass(frozen=True)
class ChainPaths:
    """Paths of a chain's parts, to read and to write."""

    pack: Path
    phones: Path  # the phonetic encoder, without suffix
    pair: Path  # the old encoder and the phonetic one as one, without suffix
    output: Path  # folder of the student


def write(
    old: OldChain, places: ChainPaths, direct: Direct, contact: Contact, listen: dict[str, Any],
    *, whole: bool,
) -> None:  # fmt: skip
    """Write encoder, student and what extends it; not whole: the student alone. `listen` goes into
    the student's card."""
    sizes, weights = listening(old, direct, contact)
    card = old.card
    names = ("teacher", "guidance", "steps", "seed", "history", TALKERS)
    kept = {k: card[k] for k in names if k in card}
    card = {
        "kind": "student",
        "config": asdict(sizes),
        "audio_sha256": _write_encoder(old, places, whole),
        "blocks": old.blocks,
        "truth": TRUTH,
        "data": {**card.get("data", {}), **read_manifest(places.pack)["sources"]},
        "listen": listen,
        **kept,
    }
    path = places.output / STUDENTS["gaze"]
    _save(path, weights, card)
    if not whole:
        return
    seeing_old = OldChain.load(old.folder, "eyes")
    sizes, seeing = listening(seeing_old, direct, contact)
    changed = {"config": asdict(sizes), "audio_sha256": card["audio_sha256"]}
    _write_beside(old.folder, places.output, seeing, changed)


def write_voice_activity(
    folder: Path, output: Path, direct: Direct, facts: dict[str, Any], *, whole: bool
) -> None:
    """Write the student of `folder` with what hears voices from `direct`, and what extends it; not
    whole: the student alone. `facts` go into its card."""
    weights, card = checkpoint.load(folder / STUDENTS["gaze"], "student")
    changed = checkpoint.arrays(direct.state_dict())
    weights |= {DIRECT + k: v for k, v in changed.items() if k.startswith(("hear.", "voice."))}
    _save(output / STUDENTS["gaze"], weights, card | {"voice_activity": facts})
    if not whole:
        return
    seeing, _ = checkpoint.load(folder / STUDENTS["eyes"], "student")
    _write_beside(folder, output, seeing, {})
    if folder != output:
        _copy(folder, output, "audio.*")


def _write_beside(folder: Path, output: Path, seeing: Weights, changed: dict[str, Any]) -> None:
    """Write what extends the student in `output` as `folder` has it: the student for eyes, of which
    `seeing` are the tensors and `changed` is what is new in its card, eyes and emotions."""
    sha = {"sha256": checkpoint.load(output / STUDENTS["gaze"], "student")[1]["sha256"]}
    own, about = checkpoint.load(folder / STUDENTS["eyes"], "student")
    about |= {"audio_model": about["audio_model"] | sha, **changed}
    _save(output / STUDENTS["eyes"], {k: v for k, v in seeing.items() if k in own}, about)
    zero, about = checkpoint.load(folder / "emotion", "emotion")
    zero = {k: v.astype(np.float16) if v.ndim > 1 else v for k, v in zero.items()}
    checkpoint.save(output / "emotion", zero, about | {"student_sha256": sha["sha256"]})
    if folder != output:
        _copy(folder, output, "eyes.*")


def _copy(folder: Path, output: Path, names: str) -> None:
    for file in folder.glob(names):
        shutil.copy(file, output)


def _save(path: Path, weights: Weights, card: dict[str, Any]) -> None:
    checkpoint.save(path, checkpoint.quantised(weights), card)


def _write_encoder(old: OldChain, places: ChainPaths, whole: bool) -> str:
    """Write the old encoder and the phonetic one as a pair; returns its sha256."""
    weights, card = checkpoint.load(old.folder / "audio", "audio")
    theirs, about = checkpoint.load(places.phones, "audio")
    weights = {k: v for k, v in weights.items() if not k.startswith(SECOND)}
    pair = replace(
        old.audio.config, second=checkpoint.config_from(AudioEncoderConfig, about["config"])
    )
    both = weights | {SECOND + name: array for name, array in theirs.items()}
    card |= {"config": asdict(pair), "second": {k: v for k, v in about.items() if k != "config"}}
    if whole:
        _save(places.pair, both, card)
    return checkpoint.load(places.pair, "audio")[1]["sha256"]
