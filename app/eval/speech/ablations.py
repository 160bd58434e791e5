"""`livedrive eval speech DATA --ablations`: the paper's tables 2 and 3 and its losses' figure.

All rows are of networks that were trained in DATA from nothing, each with a budget that the report
tells, and none of them ships; so they compare with each other, not with the shipped student.
"""

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
        kept = ("steps", "seed", "command")
        self.facts["rows"][name] = {key: card.get(key) for key in kept}
        return model

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
                if name == "distilled":  # table 2: a whole segment is what outpainting gives
                    live = evaluation.student_row(model, audio, None)
                    bare = evaluation.without_outpainting_row(model, audio, None)
                    rows.append((LIVE, "distilled, outpainted", live, draws))
                    rows.append((LIVE, "distilled, no outpainting", bare, draws))
        return [*rows, *self.non_causal_rows(segments)]

    def live_metrics(self) -> Metrics:
        return {}

    def thresholds(self, metrics: Metrics) -> list[dict[str, Any]]:
        """The paper's order: what was left out was worth having."""
        from app.terminal.thresholds import at_most

        pairs = (
            (f"{GT}/distilled", f"{GT}/regression", "lve_mm"),
            (f"{GT}/distilled", f"{GT}/regression", "lip_sync_mm"),
            (
                f"{LIVE}/distilled, outpainted",
                f"{LIVE}/distilled, no outpainting",
                "lip_velocity_mm",
            ),
            *((f"{GT}/diffusion", f"{GT}/{name}", "lip_velocity_mm") for name, _ in TEACHERS[1:]),
        )
        return [
            at_most(f"{kind}, {metric}: {a} over {b}", metrics[f"{kind}/{a}/{metric}"]
                    / metrics[f"{kind}/{b}/{metric}"], 1.0)
            for kind in self.kinds for a, b, metric in pairs
            if f"{kind}/{a}/{metric}" in metrics and f"{kind}/{b}/{metric}" in metrics
        ]  # fmt: skip
