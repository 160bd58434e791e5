"""The metrics of `livedrive eval emotion`: models, test sets, recognition and lips."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from app.eval.emotion.settings import FINE_TUNED, RULES, SHIPPED, EmotionSettings
from sensors.types import InputError

if TYPE_CHECKING:
    from torch import Tensor

    from encoder.denoiser.model import Denoiser
    from encoder.denoiser.zero_conv import ZeroConvs
    from encoder.evaluation.emotion_sets import EmotionTruth
    from encoder.evaluation.rows import Segment

Metrics = dict[str, float]
Floats = NDArray[np.float32]
EVERY = {"upper": 20, "lower": 40}  # every n-th vertex of the region is compared


class Model(NamedTuple):
    student: "Denoiser"
    zero: "ZeroConvs"


@dataclass(frozen=True)
class Confusion:
    """Region (face, upper, lower) -> confusion table [asked for, nearest truth], shares 0..1."""

    tables: dict[str, Floats]


class RowScore(NamedTuple):
    metrics: Metrics
    seen: Confusion


class EmotionEvaluation:
    """All models of one evaluation, compared on the same takes."""

    def __init__(self, data: Path, settings: EmotionSettings) -> None:
        import torch

        from app.face.geometry import lips
        from app.face.mesh import face_mesh
        from encoder.inference import WEIGHTS
        from encoder.training.checkpoints import load_encoder
        from render.decoder.decoder import Decoder

        torch.set_num_threads(1)
        self.data, self.settings, self.missing = data, settings, list[str]()
        self.weights = settings.weights or WEIGHTS
        self.mesh, self.decoder = face_mesh(settings.avatar), Decoder.load()
        self.lips = lips()
        self.encoder = load_encoder(self.weights / "audio")
        self.regions = self._regions()
        self.models: dict[str, Model] = {}
        shipped, with_lip = self.weights / "student", data / "fine-tune-lip"
        for name, student, folder in (
            (SHIPPED, shipped, self.weights),
            ("zero convolutions, the ablations' budget", shipped, data / "plain"),
            (FINE_TUNED, data / "fine-tune" / "student", data / "fine-tune"),
            ("fine-tuned, L_lip", with_lip / "student", with_lip),
            ("without L_lip", shipped, data / "no-lip"),
        ):
            if name == SHIPPED or (folder / "emotion.json").is_file():
                self.models[name] = load_model(student, folder / "emotion")
            else:
                self.missing.append(name)

    def _regions(self) -> dict[str, Callable[[Floats], Floats]]:
        """Codes [..., 256] -> vertices [..., V, 3] mm from rest, of the face and its halves."""
        sets = self.decoder.regions
        lower = np.setdiff1d(sets["narrow_face"], sets["upper_face"])
        members = {"upper": sets["upper_face"], "lower": lower}

        def moved(chosen: NDArray[np.int32]) -> Callable[[Floats], Floats]:
            linear = self.decoder.moves(chosen)
            return lambda codes: (codes @ linear).reshape(*codes.shape[:-1], -1, 3)

        halves = {name: v[:: EVERY[name]] for name, v in members.items()}
        both = np.concatenate(list(halves.values()))
        return {"face": moved(both)} | {name: moved(v) for name, v in halves.items()}

    def sets(self) -> "dict[str, list[EmotionTruth]]":
        from encoder.evaluation import emotion_sets

        geometry, data, settings = self.lips, self.data, self.settings
        found = {
            "acted voice": emotion_sets.acted(data, geometry, settings.seed),
            "neutral voice": emotion_sets.neutral(data, geometry, settings.segments, settings.seed),
            "real voice": emotion_sets.tracked(data, geometry, settings.segments, settings.seed),
        }
        self.truths = found
        return {name: takes for name, takes in found.items() if takes}

    def metrics(self, takes: "list[EmotionTruth]") -> dict[str, RowScore]:
        """Row -> score: each take in its own emotion or, where the voice is neutral, in all ten."""
        from encoder.emotion.labels import LABELS
        from encoder.evaluation import emotion
        from encoder.training.streams.emotion import ACTED_STRENGTH, SWELL

        asked = [(t, k) for t in takes for k in range(len(LABELS)) if t.label in (-1, k)]
        labels, segments = [label for _, label in asked], [take.segment for take, _ in asked]
        audio, gaze = self._inputs(segments)
        strength = ACTED_STRENGTH if takes[0].label >= 0 else 1.0
        draws = range(self.settings.samples)
        plain = self.models[SHIPPED].student
        calm = [emotion.codes(plain, None, audio, gaze, labels, 0.0, s) for s in draws]
        truths = self.decoder.encode(np.stack([take.rigs for take, _ in asked]))
        own = np.stack([rows[1 + label] for rows, label in zip(truths, labels, strict=True)])
        phones = [segment.phones for segment in segments]
        order: dict[int, int] = {}
        numbers = [order.setdefault(id(segment.clip), len(order)) for segment in segments]
        # the neutral model against the emotional truth, and against the neutral truth
        base = {
            prefix: emotion.lip_metrics(calm, truth, phones, self.mesh)
            for prefix, truth in (("neutral", own), ("neutral_own", truths[:, 0]))
        }

        def score(said: list[Floats]) -> RowScore:
            metrics, kept = emotion.lip_metrics(said, own, phones, self.mesh)
            for prefix, (others, closures) in base.items():
                metrics |= {f"{prefix}_{name}": value for name, value in others.items()}
                metrics |= emotion.closures_lost(kept, closures, numbers, prefix)
            tables = {
                name: np.mean([emotion.confusion(row, truths[:, 1:], labels, r) for row in said], 0)
                for name, r in self.regions.items()
            }
            for name, table in tables.items():
                present = table.sum(1) > 0
                metrics[f"accuracy_{name}"] = float(np.diag(table)[present].mean())
            return RowScore(metrics, Confusion(tables))

        result: dict[str, RowScore] = {}
        for name, model in self.models.items():
            said = [emotion.codes(*model, audio, gaze, labels, SWELL * strength, s) for s in draws]
            result[name] = score(said)
        laid = [emotion.laid_over(self.decoder.rig(x), labels, strength, self.lips) for x in calm]
        result[RULES] = score([self.decoder.encode(x) for x in laid])
        return result

    def _inputs(self, segments: "Sequence[Segment]") -> "tuple[Tensor, Tensor]":
        from encoder.evaluation import rows as evaluation

        audio = evaluation.features(segments, evaluation.whole(self.encoder))
        return audio, evaluation.true_gaze(segments)


def load_model(student: Path, emotion: Path) -> Model:
    from encoder.training.checkpoints import load_denoiser, load_zero_convs

    model, zero = load_denoiser(student, "student")[0], load_zero_convs(emotion)[0]
    if zero.config.places != model.config.places:
        raise InputError(
            f"checkpoint {emotion}: expected convolutions for {student}, got those of another "
            f"student; run livedrive train emotion --start {student.parent}"
        )
    return Model(model, zero)
