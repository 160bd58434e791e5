"""`livedrive eval speech DATA --peers DIR`: the paper's table 1, with twins of its baselines.

The twins hear each clip as a whole and see no gaze; ours hears no future. Rows of ours are the
shipped student, with the gaze that was recorded and with a synthesised one (the paper's row).
"""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from app.eval.speech.evaluate import SpeechEvaluation, report
from app.eval.speech.settings import SpeechSettings
from app.eval.speech.tables import GT, LIVE, OFFLINE, SYNTHESISED, Metrics
from sensors.types import InputError

if TYPE_CHECKING:
    from torch import Tensor

    from encoder.evaluation.rows import Row, Segment
    from encoder.training.peers.parts import PeerNetwork

ROWS = (  # name of the twin, of the row; whether it takes its style from the truth
    ("talkshow", "TalkSHOW-face", False),
    ("audio2photoreal", "Audio2Photoreal-face", False),
    ("diffposetalk", "DiffPoseTalk without style", False),
    ("diffposetalk", "DiffPoseTalk with style (hypothetical)", True),
)
FED_CAUSALLY = "TalkSHOW-face, fed causally"


def evaluate(data: Path, settings: SpeechSettings) -> None:
    """Free speech, sentences and real motion; languages of rule-made voices are left out."""
    evaluated = BaselineEvaluation(data, settings)
    if settings.films:
        from app.eval.speech.films import save

        titles = {title: name for name, title, styled in ROWS if not styled}
        save(evaluated, settings.films, {t: n for t, n in titles.items() if n in evaluated.peers})
    else:
        report(evaluated)


def without_languages(kinds: "dict[str, list[Segment]]") -> "dict[str, list[Segment]]":
    """Rule-made voices that say the same in many languages tell no more than one of them."""
    return {k: v for k, v in kinds.items() if not k.startswith("language")}


class BaselineEvaluation(SpeechEvaluation):
    def __init__(self, data: Path, settings: SpeechSettings) -> None:
        from encoder.training.peers.kinds import load_peer

        folder = settings.peers
        assert folder is not None
        if not any((folder / f"{name}.json").is_file() for name, _, _ in ROWS):
            raise InputError(
                f"--peers {folder}: expected twins of the baselines, got none; "
                "make them with livedrive train peers --name NAME"
            )
        super().__init__(data, settings)
        self.peers: dict[str, PeerNetwork] = {}
        for name in dict.fromkeys(name for name, _, _ in ROWS):
            if self.trained(name, folder / name):
                self.peers[name], card = load_peer(folder / name)
                kept = ("parameters", "budget", "seed", "command")
                self.facts.setdefault("peers", {})[name] = {key: card.get(key) for key in kept}
                self._check(folder / name, card.get("audio_sha256"))
        self.kinds = without_languages(self.kinds)

    def _check(self, path: Path, heard: object) -> None:
        ours = self.card.get("audio_sha256")
        if heard != ours:
            raise InputError(
                f"--peers: expected {path} to hear by the audio encoder of the student, got "
                "another; train it again"
            )

    def rows(self, segments: "list[Segment]") -> "list[tuple[str, str, Row, int]]":
        from encoder.evaluation import rows as evaluation

        draws = self.settings.samples
        audio = evaluation.features(segments, evaluation.whole(self.encoder))
        gaze = evaluation.true_gaze(segments)
        mean = np.broadcast_to(self.driver.mean, (*audio.shape[:2], len(self.driver.mean)))
        rows: list[tuple[str, str, Row, int]] = [
            (GT, "mean face", lambda seed: mean, 1),
            (GT, "student", evaluation.student_row(self.student, audio, gaze), draws),
            (SYNTHESISED, "student", evaluation.student_row(self.student, audio, None), draws),
        ]
        truth = self.truth(segments)
        for name, title, styled in ROWS:
            if name in self.peers:
                peer = self.peers[name]
                row = peer_row(peer, audio, truth if styled else None)
                rows.append((OFFLINE, title, row, draws if peer.draws else 1))
        if "talkshow" in self.peers:
            rows.append((LIVE, FED_CAUSALLY, fed_causally_row(self.peers["talkshow"], audio), 1))
        return rows

    def live_metrics(self) -> Metrics:
        return {}

    def thresholds(self, metrics: Metrics) -> list[dict[str, Any]]:
        """Is ours first, among those that are shown nothing of the truth?"""
        from app.terminal.thresholds import at_most

        found: list[dict[str, Any]] = []
        for kind in self.kinds:
            for name in ("lve_mm", "lip_sync_mm"):
                rows = [
                    f"{kind}/{OFFLINE}/{title}/{name}" for _, title, styled in ROWS if not styled
                ]
                best = min(metrics[row] for row in rows if row in metrics)
                ours = metrics[f"{kind}/{SYNTHESISED}/student/{name}"]
                found.append(at_most(f"{kind} {name} over the best twin's", ours / best, 1.0))
        return found


def peer_row(peer: "PeerNetwork", audio: "Tensor", truth: np.ndarray | None) -> "Row":
    """audio [S, T, A] of whole segments; truth: codes [S, T, 256] to take the style from."""
    import torch

    from encoder.evaluation.rows import noise

    style = None if truth is None else torch.tensor(truth)

    @torch.no_grad()
    def row(seed: int) -> np.ndarray:  # [S, T, 256]
        start = noise((*audio.shape[:2], peer.config.expression_dim), seed)
        return peer.codes(audio, start, style).numpy()

    return row


def fed_causally_row(peer: "PeerNetwork", audio: "Tensor") -> "Row":
    """Each frame as the twin shows it when nothing is heard after it: what it would do live."""
    import torch

    from encoder.evaluation.rows import noise

    @torch.no_grad()
    def row(seed: int) -> np.ndarray:  # [S, T, 256]
        start = noise((*audio.shape[:2], peer.config.expression_dim), seed)
        newest = [
            peer.codes(audio[:, : t + 1], start[:, : t + 1])[:, -1] for t in range(audio.shape[1])
        ]
        return torch.stack(newest, 1).numpy()

    return row
