"""`livedrive eval speech DATA`: the paper's tables 1-3, and further tests of a causal model.

The paper's three settings are separate: recorded gaze, synthesised gaze, and the live path. A row
whose model was not trained (see `livedrive train --variant`) is left out and listed as missing.
"""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from app.eval.speech.models import SpeechModels
from app.eval.speech.settings import SpeechSettings
from app.eval.speech.tables import GT, LIVE, SYNTHESISED, Metrics, make_thresholds, show

if TYPE_CHECKING:
    from collections.abc import Iterator

    from encoder.evaluation.rows import Row, Segment


def evaluate(data: Path, settings: SpeechSettings) -> None:
    """Print tables and thresholds; exit with status 1 where one fails.

    data: folder made by `livedrive capture`; teacher and ablations are expected in it.
    """
    report(SpeechEvaluation(data, settings))


def report(evaluated: "SpeechEvaluation") -> None:
    """Print its tables, metrics and thresholds, and write what the settings ask for.

    The report is written anew after each kind of clip: a stopped evaluation leaves what it has.
    """
    from app.terminal.thresholds import finish, print_metrics, write

    settings, metrics = evaluated.settings, dict[str, float]()
    for kind, table in evaluated.tables():
        show({kind: table})
        metrics |= {
            f"{kind}/{setting}/{row}/{name}": value
            for setting, rows in table.items()
            for row, measured in rows.items()
            for name, value in measured.items()
        }
        write(evaluated.told(metrics, []), settings.report)
    metrics = evaluated.live_metrics() | metrics
    print_metrics(metrics, evaluated.missing)
    if settings.plots:
        for path in evaluated.save_plots(settings.plots, metrics):
            print(f"wrote {path}")
    finish(evaluated.told(metrics, evaluated.thresholds(metrics)), settings.report)


class SpeechEvaluation(SpeechModels):
    """The rows of those models in the tables, and their thresholds."""

    def tables(self) -> "Iterator[tuple[str, dict[str, dict[str, Metrics]]]]":
        """Kind of clip, and setting -> row -> metrics, as each is measured."""
        from tqdm import tqdm

        for kind, segments in tqdm(self.kinds.items(), unit="kind", disable=None):
            yield kind, self._table(segments)

    def told(self, metrics: Metrics, thresholds: list[dict[str, Any]]) -> dict[str, Any]:
        """The report."""
        settings = self.settings
        facts = {"seed": settings.seed, "avatar": settings.avatar}
        facts |= {"samples": settings.samples, "segments": settings.segments}
        facts |= {"test_set": self.data.name, "not_trained": self.missing, **self.facts}
        rounded = {name: round(value, 4) for name, value in metrics.items()}
        return {"metrics": rounded, "bars": thresholds, **facts}

    def _table(self, segments: "list[Segment]") -> dict[str, dict[str, Metrics]]:
        from encoder.evaluation.judging import TruthMeshes, judge

        codes = self.truth(segments)
        truth = TruthMeshes.of(segments, codes, self.mesh)
        result: dict[str, dict[str, Metrics]] = {}
        for setting, name, row, draws in self.rows(segments):
            samples = [row(seed) for seed in range(draws)]
            result.setdefault(setting, {})[name] = judge(samples, truth, self.mesh)
        return result

    def rows(self, segments: "list[Segment]") -> "list[tuple[str, str, Row, int]]":
        """Rows to evaluate: (setting, name, row, number of samples)."""
        from app.eval.speech.live import live_codes
        from encoder.denoiser.model import headless
        from encoder.evaluation import rows as evaluation

        draws = self.settings.samples
        audio = evaluation.features(segments, evaluation.whole(self.encoder))
        gaze = evaluation.true_gaze(segments)
        mean = np.broadcast_to(self.driver.mean, (*audio.shape[:2], len(self.driver.mean)))
        student, student_row = self.student, evaluation.student_row

        def live(seed: int) -> np.ndarray:
            return live_codes(self.driver, segments, seed)

        plain = headless(student)
        rows: list[tuple[str, str, Row, int]] = [
            (GT, "mean face", lambda seed: mean, 1),
            (GT, "energy to jaw", self._energy_to_jaw(segments), 1),
            (GT, "student", student_row(student, audio, gaze), draws),
            (GT, "no contact head", student_row(plain, audio, gaze), draws),
            (SYNTHESISED, "student", student_row(student, audio, None), draws),
            (LIVE, "student", live, draws),
        ]
        if self.settings.brief:
            return rows
        bare = evaluation.without_outpainting_row(student, audio, None)
        rows.append((LIVE, "no outpainting", bare, draws))
        return rows + self.trained_rows(segments, audio, gaze)

    def _energy_to_jaw(self, segments: "list[Segment]") -> "Row":
        from encoder.capture.motion.channels import JAW_OPEN
        from encoder.evaluation import rows as evaluation

        fit = evaluation.fit_energy_to_jaw(self.data, JAW_OPEN)
        rig = evaluation.energy_to_jaw_rig(segments, fit, JAW_OPEN)
        return lambda seed: self.decoder.encode(rig)

    def live_metrics(self) -> Metrics:
        """Metrics of the live path: silence, noise, real speech, ten minutes without a break."""
        from app.eval.speech import live as eval_live

        settings, result = self.settings, eval_live.rest_metrics(self.driver, self.mesh, 0)
        if settings.speech:
            result |= eval_live.speech_metrics(
                self.driver, self.mesh, settings.speech, settings.every, settings.seed
            )
        if not settings.brief and self.kinds:
            segments = max(self.kinds.values(), key=len)
            result |= eval_live.drift_metrics(
                self.driver, segments, self.truth(segments), self.mesh, settings.seed
            )
        return result

    def thresholds(self, metrics: Metrics) -> list[dict[str, Any]]:
        return make_thresholds(metrics)

    def save_plots(self, folder: Path, metrics: Metrics) -> list[Path]:
        """Plot the student's error over a shift for each kind of clip, and all loss curves."""
        from app.eval import plots as eval_plots
        from encoder import inference
        from encoder.evaluation import rows as evaluation

        shifts: dict[str, list[float]] = {}
        for kind, segments in self.kinds.items():
            audio = evaluation.features(segments, evaluation.whole(self.encoder))
            row = evaluation.student_row(self.student, audio, evaluation.true_gaze(segments))
            guess, real = (
                [self.mesh.opening_mm(codes) for codes in rows]
                for rows in (row(0), self.truth(segments))
            )
            shifts[kind] = eval_plots.shift_errors(guess, real)
        weights = self.settings.weights or inference.WEIGHTS
        cards = [*sorted(weights.glob("*.json")), *sorted(self.data.glob("*.json"))]
        cards += sorted(self.data.glob("*/teacher.json"))
        return eval_plots.save(folder, shifts, eval_plots.curves_of(cards))
