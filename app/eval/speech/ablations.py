"""`livedrive eval speech DATA --ablations`: the paper's tables 2 and 3 and its losses' figure.

All rows are of networks that were trained in DATA from nothing, each with a budget that the report
tells, and none of them ships; so they compare with each other, not with the shipped student.
"""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.eval.speech.baselines import without_languages
from app.eval.speech.evaluate import SpeechEvaluation, report
from app.eval.speech.settings import SpeechSettings
from app.eval.speech.tables import GT, LIVE, Metrics

if TYPE_CHECKING:
    from encoder.denoiser.model import Denoiser
    from encoder.evaluation.rows import Row, Segment

TEACHERS = (  # section 6.3: the diffusion model and its geometry losses; commands: train diffusion
    ("diffusion", "teacher"),
    ("diffusion without L_vel", "no-velocity/teacher"),
    ("diffusion without L_jitter", "no-jitter/teacher"),
    ("diffusion, L_jitter not normalised", "plain-jitter/teacher"),
)
STUDENTS = (  # table 3
    ("regression", "regression"),
    ("distilled", "plain/student"),
    ("distilled without L_DMD", "no-dmd/student"),
)
ENCODERS = (  # table 2: an audio encoder and a student of its own each, of one budget
    ("non-causal encoder", "centred"),
    ("causal encoder", "causal"),
)
TABLE_2 = ("lve_mm", "lip_sync_mm", "lip_velocity_mm")
STEPS = (  # of table 2, better than what they follow
    ("causal encoder, no outpainting", "non-causal encoder, no outpainting"),
    ("causal encoder, outpainted", "causal encoder, no outpainting"),
)


def evaluate(data: Path, settings: SpeechSettings) -> None:
    """Free speech, sentences and real motion."""
    report(AblationEvaluation(data, settings))


class AblationEvaluation(SpeechEvaluation):
    def __init__(self, data: Path, settings: SpeechSettings) -> None:
        super().__init__(data, settings)
        self.kinds = without_languages(self.kinds)
        self.facts["rows"] = {}

    def _load(self, name: str, path: Path) -> "Denoiser | None":
        from encoder.training.checkpoints import load_denoiser

        if not self.trained(name, path):
            return None
        model, card = load_denoiser(path, "diffusion", "student")
        self._note(name, card)
        return model

    def _note(self, name: str, card: dict[str, Any]) -> None:
        kept = ("steps", "seed", "command")
        self.facts["rows"][name] = {key: card.get(key) for key in kept}

    def _encoder_rows(self, segments: "list[Segment]") -> "list[tuple[str, str, Row, int]]":
        """Table 2: students fed frame by frame, each by the encoder that it learned from."""
        from encoder.evaluation import rows as evaluation
        from encoder.nn.checkpoint import load
        from encoder.training.centred import CentredEncoder, fed_causally
        from encoder.training.checkpoints import load_encoder

        draws = self.settings.samples
        rows: list[tuple[str, str, Row, int]] = []
        for name, place in ENCODERS:
            model = self._load(name, self.data / place / "student")
            if model is None:
                continue
            path = self.data / place / "audio"
            encoder = load_encoder(path)
            self._note(f"{name}, itself", load(path, "audio", "centred")[1])
            if isinstance(encoder, CentredEncoder):
                encode = partial(fed_causally, encoder, samples_per_frame=800)
            else:
                encode = evaluation.whole(encoder)
            heard = evaluation.features(segments, encode)
            bare = evaluation.without_outpainting_row(model, heard, None)
            rows.append((LIVE, f"{name}, no outpainting", bare, draws))
            if place == "causal":
                live = evaluation.student_row(model, heard, None)
                rows.append((LIVE, f"{name}, outpainted", live, draws))
        return rows

    def rows(self, segments: "list[Segment]") -> "list[tuple[str, str, Row, int]]":
        from encoder.denoiser.diffusion import Guidance
        from encoder.evaluation import rows as evaluation

        draws = self.settings.samples
        audio = evaluation.features(segments, evaluation.whole(self.encoder))
        gaze = evaluation.true_gaze(segments)
        rows: list[tuple[str, str, Row, int]] = []
        for name, place in TEACHERS:
            model = self._load(name, self.data / place)
            if model is not None:
                row = evaluation.teacher_row(model, audio, gaze, Guidance())
                rows.append((GT, name, row, draws))
        for name, place in STUDENTS:
            model = self._load(name, self.data / place)
            if model is not None:
                several = 1 if name == "regression" else draws
                rows.append((GT, name, evaluation.student_row(model, audio, gaze), several))
        return [*rows, *self._encoder_rows(segments)]

    def save_plots(self, folder: Path, metrics: Metrics) -> list[Path]:
        """The figure of section 6.3: what each geometry loss does, over the model with both."""
        from app.eval import plots

        names = [name for name, _ in TEACHERS if name not in self.missing]
        if len(names) < 2 or names[0] != TEACHERS[0][0]:
            return []

        def ratios(name: str, metric: str) -> list[float]:
            rows = [f"{kind}/{GT}/{{}}/{metric}" for kind in self.kinds]
            return [metrics[row.format(name)] / metrics[row.format(names[0])] for row in rows]

        panels = {
            title: [ratios(name, metric) for name in names]
            for title, metric in (
                ("LVE", "lve_mm"), ("lip sync", "lip_sync_mm"), ("lip velocity", "lip_velocity_mm")
            )
        }  # fmt: skip
        short = ["both", *(name.removeprefix("diffusion").strip(", ") for name in names[1:])]
        title = "Error over that of the model with both losses; a dot is a kind of clip"
        return [plots.save_ratios(folder / "geometry_losses.png", title, short, panels)]

    def live_metrics(self) -> Metrics:
        return {}

    def thresholds(self, metrics: Metrics) -> list[dict[str, Any]]:
        """The paper's order: what was left out was worth having."""
        from app.terminal.thresholds import at_most

        pairs = (
            (f"{GT}/distilled", f"{GT}/regression", "lve_mm"),
            (f"{GT}/distilled", f"{GT}/regression", "lip_sync_mm"),
            *((f"{LIVE}/{a}", f"{LIVE}/{b}", metric) for a, b in STEPS for metric in TABLE_2),
            *((f"{GT}/diffusion", f"{GT}/{name}", "lip_velocity_mm") for name, _ in TEACHERS[1:]),
        )
        return [
            at_most(f"{kind}, {metric}: {a} over {b}", metrics[f"{kind}/{a}/{metric}"]
                    / metrics[f"{kind}/{b}/{metric}"], 1.0)
            for kind in self.kinds for a, b, metric in pairs
            if f"{kind}/{a}/{metric}" in metrics and f"{kind}/{b}/{metric}" in metrics
        ]  # fmt: skip
