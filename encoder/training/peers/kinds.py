"""The twins by name, and from disk."""

from pathlib import Path
from typing import Any

from encoder.nn.checkpoint import config_from, load
from encoder.nn.modules import fill
from encoder.training.peers.audio2photoreal import Audio2Photoreal
from encoder.training.peers.diffposetalk import DiffPoseTalk
from encoder.training.peers.parts import PeerConfig, PeerName, PeerNetwork
from encoder.training.peers.talkshow import TalkShow

KINDS: dict[PeerName, type[PeerNetwork]] = {
    "talkshow": TalkShow, "audio2photoreal": Audio2Photoreal, "diffposetalk": DiffPoseTalk,
}  # fmt: skip


def make_peer(config: PeerConfig) -> PeerNetwork:
    return KINDS[config.name](config)


def load_peer(path: Path) -> tuple[PeerNetwork, dict[str, Any]]:
    """A twin and its card, from `path` without suffix."""
    weights, card = load(path, "peer")
    return fill(make_peer(config_from(PeerConfig, card["config"])), weights, path, "peer"), card
