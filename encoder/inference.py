"""The trained networks of a folder, checked against each other, and the Driver made from them.

`load_driver` is what the app calls. Without a GPU nothing here imports torch.
"""

from __future__ import annotations

import ctypes
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from encoder.audio.config import AudioEncoderConfig
from encoder.audio.config import weight_shapes as audio_shapes
from encoder.backends import BackendName, Networks, create_backend
from encoder.denoiser.config import DenoiserConfig
from encoder.denoiser.config import weight_shapes as denoiser_shapes
from encoder.nn.checkpoint import check_shapes, config_from, load
from encoder.types import Condition, Weights
from sensors import files
from sensors.types import InputError

if TYPE_CHECKING:
    from encoder.driver import Driver
    from encoder.eyes.calibration import EyeCalibration

WEIGHTS = Path(__file__).parent / "weights"
STUDENTS: dict[Condition, str] = {"gaze": "student", "eyes": "student_eyes"}


def load_networks(
    weights_dir: Path | str | None = None, condition: Condition = "gaze"
) -> tuple[Networks, dict[str, Any]]:
    """Audio encoder and student of a folder, and the student's card."""
    folder = WEIGHTS if weights_dir is None else Path(weights_dir)
    audio, audio_card = load(folder / "audio", "audio")
    audio_config = config_from(AudioEncoderConfig, audio_card["config"])
    check_shapes(audio, audio_shapes(audio_config), folder / "audio", "audio")
    config, denoiser, card = load_student(folder, condition)
    if card.get("audio_sha256", audio_card["sha256"]) != audio_card["sha256"]:
        raise InputError(
            f"checkpoint {folder / 'student'}: expected the audio encoder it was trained with, got "
            "another; run `livedrive train distill` or restore both files"
        )
    return Networks(audio_config, audio, config, denoiser), card


def load_student(
    folder: Path, condition: Condition
) -> tuple[DenoiserConfig, Weights, dict[str, Any]]:
    """The student of a folder; the one for eyes may hold only what it has beyond the other."""
    path = folder / STUDENTS[condition]
    weights, card = load(path, "student")
    config = config_from(DenoiserConfig, card["config"])
    shapes = denoiser_shapes(config)
    if weights.keys() < shapes.keys():
        base, base_card = load(folder / STUDENTS["gaze"], "student")
        if card.get("audio_model", {}).get("sha256") != base_card["sha256"]:
            raise InputError(
                f"checkpoint {path}: expected the {STUDENTS['gaze']} beside it that it was made "
                "from, got another; run `livedrive train multimodal` or restore both files"
            )
        weights = base | weights
    check_shapes(weights, shapes, path, "student")
    return config, weights, card


def load_driver(
    weights_dir: Path | str | None = None,
    device: Literal["auto", "cpu", "cuda"] = "auto",
    backend: BackendName = "auto",
    condition: Condition = "gaze",
    calibration: EyeCalibration | None = None,
) -> Driver:
    """The trained Driver. Device "auto" is the GPU where PyTorch sees one."""
    from encoder.driver import Driver
    from encoder.emotion.control import load_emotions
    from encoder.eyes.encoder import load_eye_encoder

    if device == "auto":
        device = "cuda" if not backend.startswith("onnx") and has_gpu() else "cpu"
    if device == "cuda" and not has_gpu():
        raise InputError("device: expected a CUDA GPU, got none; use --device cpu")
    networks, card = load_networks(weights_dir, condition)
    folder = WEIGHTS if weights_dir is None else Path(weights_dir)
    eyes = load_eye_encoder(folder) if condition == "eyes" else None
    # the student for eyes is the audio model but for its first layers: the same emotions add to it
    # the same faces (smiles, brows: cosine of the codes' changes 0.997 and more)
    emotions = load_emotions(folder, card.get("audio_model", card)["sha256"])
    return Driver(
        create_backend(networks, backend, device),
        networks.config,
        mean=networks.denoiser["expression_mean"],
        std=networks.denoiser["expression_std"],
        eyes=eyes,
        emotions=emotions,
        calibration=calibration,
    )


def has_gpu() -> bool:
    """Does PyTorch see a CUDA GPU? It is asked, and imported, only where a driver is installed."""
    try:
        ctypes.CDLL("nvcuda.dll" if sys.platform == "win32" else "libcuda.so.1")
    except OSError:
        return False
    import torch

    return torch.cuda.is_available()


def choose_condition(
    wanted: Literal["auto", "gaze", "eyes"], has_eyes: bool, weights: Path = WEIGHTS
) -> Condition:
    """auto: the eyes, where the source has pictures of them and their weights fit the others."""
    if wanted != "auto":
        return wanted
    return "eyes" if has_eyes and eyes_fit(weights) else "gaze"


def eyes_fit(folder: Path) -> bool:
    """Are there an eye encoder and a student that sees, made from the gaze student beside them?"""
    cards: dict[str, Any] = {}
    for name in ("eyes", *STUDENTS.values()):
        path = folder / f"{name}.json"
        if not path.is_file():
            return False
        try:
            cards[name] = card = files.read_json(path)
            if not isinstance(card, dict) or "sha256" not in card:
                raise ValueError("no sha256")
        except ValueError as error:
            raise InputError(
                f"checkpoint {path}: expected a card in JSON, got {error}; restore it"
            ) from None
    seeing = cards[STUDENTS["eyes"]]
    return (
        seeing.get("audio_model", {}).get("sha256") == cards[STUDENTS["gaze"]]["sha256"]
        # an eye encoder may have learned to see more without changing what its features mean
        and seeing.get("eyes_sha256") in (cards["eyes"]["sha256"], cards["eyes"].get("features_of"))
    )
