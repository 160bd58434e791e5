"""The trained networks of a folder, checked against each other, and the Driver made from them.

`load_driver` is what the app calls.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from encoder.audio_encoder import AudioEncoder, AudioEncoderConfig
from encoder.backends import BackendName, create_backend
from encoder.checkpoint import config_from, load
from encoder.denoiser import Denoiser, DenoiserConfig
from sensors.types import InputError

if TYPE_CHECKING:
    from encoder.driver import Driver

Condition = Literal["gaze", "eyes"]
WEIGHTS = Path(__file__).parent / "weights"
STUDENTS: dict[Condition, str] = {"gaze": "student", "eyes": "student_eyes"}


def load_models(
    weights_dir: Path | str | None = None, condition: Condition = "gaze"
) -> tuple[AudioEncoder, Denoiser, dict]:
    """Read audio and student checkpoints of a folder -> both networks and the student's card."""
    folder = WEIGHTS if weights_dir is None else Path(weights_dir)
    tensors, audio_card = load(folder / "audio", "audio")
    encoder = AudioEncoder(config_from(AudioEncoderConfig, audio_card["config"]))
    fill(encoder, tensors, folder / "audio")
    denoiser, card = load_student(folder, condition)
    if card.get("audio_sha256", audio_card["sha256"]) != audio_card["sha256"]:
        raise InputError(
            f"checkpoint {folder / 'student'}: expected the audio encoder it was trained with, got "
            "another; run `livedrive train distill` or restore both files"
        )
    return encoder.eval(), denoiser.eval(), card


def load_student(folder: Path, condition: Condition) -> tuple[Denoiser, dict]:
    """The student of a folder; one that sees may hold only what it learned beyond the other."""
    path = folder / STUDENTS[condition]
    tensors, card = load(path, "student")
    denoiser = Denoiser(config_from(DenoiserConfig, card["config"]))
    if tensors.keys() < denoiser.state_dict().keys():
        base, base_card = load(folder / STUDENTS["gaze"], "student")
        if card.get("audio_model", {}).get("sha256") != base_card["sha256"]:
            raise InputError(
                f"checkpoint {path}: expected the {STUDENTS['gaze']} beside it that it was made "
                "from, got another; run `livedrive train multimodal` or restore both files"
            )
        tensors = base | tensors
    fill(denoiser, tensors, path)
    return denoiser, card


def fill(module: AudioEncoder | Denoiser, tensors: dict[str, Any], path: Path) -> None:
    """load_state_dict whose errors are one line."""
    expected = {name: tensor.shape for name, tensor in module.state_dict().items()}
    got = {name: tensor.shape for name, tensor in tensors.items()}
    if expected != got:
        odd = sorted(k for k in expected.keys() | got.keys() if expected.get(k) != got.get(k))
        raise InputError(
            f"checkpoint {path}: expected the tensors of its config, got other names or shapes "
            f"({', '.join(odd[:3])}, ...); restore the file"
        )
    module.load_state_dict(tensors)


def load_driver(
    weights_dir: Path | str | None = None,
    device: Literal["auto", "cpu", "cuda"] = "auto",
    backend: BackendName = "auto",
    condition: Condition = "gaze",
) -> Driver:
    """The trained Driver. Device "auto" is the GPU where PyTorch sees one."""
    import torch

    from encoder.driver import Driver
    from encoder.emotion import load_emotions
    from encoder.eye_encoder import load_eye_encoder

    if device == "auto":
        device = "cuda" if torch.cuda.is_available() and not backend.startswith("onnx") else "cpu"
    if device == "cuda" and not torch.cuda.is_available():
        raise InputError("device: expected a CUDA GPU, got none; use --device cpu")
    encoder, denoiser, card = load_models(weights_dir, condition)
    folder = WEIGHTS if weights_dir is None else Path(weights_dir)
    eyes = load_eye_encoder(folder) if condition == "eyes" else None
    # a student that sees is the audio model but for its first layers: the same emotions add to it
    # the same faces (smiles, brows: cosine of the codes' changes 0.997 and more)
    emotions = load_emotions(folder, card.get("audio_model", card)["sha256"])
    runner = create_backend(encoder, denoiser, backend, device)
    return Driver(runner, denoiser, eyes, emotions=emotions)


def choose_condition(wanted: Literal["auto", "gaze", "eyes"], has_eyes: bool) -> Condition:
    """auto: the eyes, where the source has pictures of them and their weights fit the others."""
    if wanted != "auto":
        return wanted
    return "eyes" if has_eyes and eyes_fit(WEIGHTS) else "gaze"


def eyes_fit(folder: Path) -> bool:
    """Are there an eye encoder and a student that sees, made from the gaze student beside them?"""
    cards: dict[str, Any] = {}
    for name in ("eyes", *STUDENTS.values()):
        path = folder / f"{name}.json"
        if not path.is_file():
            return False
        cards[name] = json.loads(path.read_text())
    seeing = cards[STUDENTS["eyes"]]
    return (
        seeing.get("audio_model", {}).get("sha256") == cards[STUDENTS["gaze"]]["sha256"]
        and seeing.get("eyes_sha256") == cards["eyes"]["sha256"]
    )
