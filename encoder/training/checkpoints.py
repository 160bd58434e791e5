"""Checkpoints as torch modules in full precision, for training stages and evaluations."""

from pathlib import Path
from typing import Any

from encoder.audio.config import AudioEncoderConfig
from encoder.audio.encoder import AudioEncoder
from encoder.denoiser.config import DenoiserConfig, ZeroConvConfig
from encoder.denoiser.model import Denoiser
from encoder.denoiser.zero_conv import ZeroConvs
from encoder.eyes.format import EyeNetConfig
from encoder.eyes.network import EyeNet
from encoder.nn.checkpoint import config_from, load
from encoder.nn.modules import fill
from encoder.training.centred import CentredEncoder
from sensors.types import InputError

Card = dict[str, Any]


def load_encoder(path: Path) -> AudioEncoder:
    """The audio encoder of a checkpoint, causal or centred."""
    weights, card = load(path, "audio", "centred")
    config = config_from(AudioEncoderConfig, card["config"])
    kind = CentredEncoder if card["kind"] == "centred" else AudioEncoder
    return fill(kind(config), weights, path, card["kind"])


def load_denoiser(path: Path, *kinds: str) -> tuple[Denoiser, Card]:
    weights, card = load(path, *kinds)
    return fill(
        Denoiser(config_from(DenoiserConfig, card["config"])), weights, path, card["kind"]
    ), card


def load_zero_convs(path: Path) -> tuple[ZeroConvs, Card]:
    """The zero convolutions of a checkpoint and its card, whatever student they extend."""
    weights, card = load(path, "emotion")
    return fill(
        ZeroConvs(config_from(ZeroConvConfig, card["config"])), weights, path, card["kind"]
    ), card


def load_eye_net(path: Path) -> tuple[EyeNet, Card]:
    weights, card = load(path, "eyes")
    return fill(
        EyeNet(config_from(EyeNetConfig, card["config"])), weights, path, card["kind"]
    ), card


def check_hears(path: Path, card: Card, about: Card) -> None:
    """Raise InputError where the network of a card has learned from another audio encoder than
    that of the streams which `about` describes."""
    heard = about["audio_sha256"]
    if card.get("audio_sha256", heard) != heard:
        raise InputError(
            f"{path}: expected a network that hears by the audio encoder of the streams, got one "
            "of another; train it anew"
        )
