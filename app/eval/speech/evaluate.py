"""`livedrive eval speech DATA`: the paper's tables 1-3, and further tests of a causal model.

The paper's three settings are separate: recorded gaze, synthesised gaze, and the live path. A row
whose model was not trained (see `livedrive train --variant`) is left out and listed as missing.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from app.eval.settings import EvalSettings
from app.eval.speech.tables import GT, LIVE, SYNTHESISED, Metrics, make_thresholds, show
from app.terminal.arguments import File

if TYPE_CHECKING:
    from encoder.evaluation.rows import Row, Segment


@dataclass(frozen=True, kw_only=True)
class SpeechSettings(EvalSettings):
    """Evaluate audio encoder, teacher and student on held-out clips, silence and noise."""

    weights: File = None
    """Folder with the weights of audio encoder and student; default: the shipped ones."""
    speech: File = None
    """Folder of further speech recordings, not used in training."""
    every: int = 1
    """Use only every n-th of them."""
    samples: int = 5
    """Samples drawn for each row (the paper: 5)."""
    segments: int = 24
    """Most segments of 100 frames of each kind of clip."""
    brief: bool = False
    """Only the shipped student: no teacher, no ablations, no ten-minute run."""
    leave_one_out: bool = False
    """Instead: evaluate each talker of --mocap with the student in DATA/leave_out that was trained
    without that talker (`livedrive train distill --leave-out TALKER`)."""
    mocap: File = None
    """Folder of tracked faces, for --leave-one-out."""
    plots: File = None
    """Folder for plots: loss curves, and the error over a constant shift."""


def evaluate(data: Path, settings: SpeechSettings) -> None:
    """Print tables and thresholds; exit with status 1 where one fails.

    data: folder made by `livedrive capture`; teacher and ablations are expected in it.
    """
    from app.terminal.thresholds import finish, print_metrics

    evaluated = SpeechEvaluation(data, settings)
    tables = evaluated.tables()
    metrics = evaluated.live_metrics() | {
        f"{kind}/{setting}/{row}/{name}": value
        for kind, table in tables.items()
        for setting, rows in table.items()
        for row, metrics in rows.items()
        for name, value in metrics.items()
    }
    show(tables)
    print_metrics(metrics, evaluated.missing)
    if settings.plots:
        for path in evaluated.save_plots(settings.plots):
            print(f"wrote {path}")
    thresholds = make_thresholds(metrics)
    facts = {"seed": settings.seed, "avatar": settings.avatar}
    facts |= {"samples": settings.samples, "segments": settings.segments}
    facts |= {"test_set": str(data), "not_trained": evaluated.missing}
    rounded = {name: round(value, 4) for name, value in metrics.items()}
    finish({"metrics": rounded, "bars": thresholds, **facts}, settings.report)


class SpeechEvaluation:
    """All models of one evaluation and their rows of the tables."""

    def __init__(self, data: Path, settings: SpeechSettings) -> None:
        import torch

        from app.face.mesh import face_mesh
        from encoder import inference
        from encoder.evaluation.rows import held_out_segments
        from render.decoder.decoder import Decoder

        torch.set_num_threads(1)
        self.data, self.settings, self.missing = data, settings, list[str]()
        self.mesh, self.decoder = face_mesh(settings.avatar), Decoder.load()
        networks, self.card = inference.load_networks(settings.weights)
        self.encoder, self.student = networks.modules()
        self.driver = inference.load_driver(settings.weights, "cpu")
        self.kinds = held_out_segments(data, settings.segments, settings.seed)

    def tables(self) -> dict[str, dict[str, dict[str, Metrics]]]:
        """Kind of clip -> setting -> row -> metrics."""
        from tqdm import tqdm

        return {
            kind: self._table(segments)
            for kind, segments in tqdm(self.kinds.items(), unit="kind", disable=None)
        }

    def _table(self, segments: "list[Segment]") -> dict[str, dict[str, Metrics]]:
        from encoder.evaluation.judging import TruthMeshes, judge

        codes = self._truth(segments)
        truth = TruthMeshes.of(segments, codes, self.mesh)
        result: dict[str, dict[str, Metrics]] = {}
        for setting, name, row, draws in self._rows(segments):
            samples = [row(seed) for seed in range(draws)]
            result.setdefault(setting, {})[name] = judge(samples, truth, self.mesh)
        return result

    def _truth(self, segments: "list[Segment]") -> np.ndarray:  # [S, 100, 256]
        return self.decoder.encode(np.stack([segment.rig for segment in segments]))

    def _rows(self, segments: "list[Segment]") -> "list[tuple[str, str, Row, int]]":
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
        return rows + self._trained_rows(segments, audio, gaze)

    def _trained_rows(
        self, segments: "list[Segment]", audio: Any, gaze: Any
    ) -> "list[tuple[str, str, Row, int]]":
        """Rows of models that are not shipped: teacher and ablations, where they were trained."""
        from encoder.denoiser.diffusion import Guidance
        from encoder.evaluation import rows as evaluation
        from encoder.training.centred import CentredEncoder, fed_causally
        from encoder.training.checkpoints import load_denoiser, load_encoder

        data, draws = self.data, self.settings.samples
        guidance = Guidance(**self.card.get("guidance", {}))
        rows: list[tuple[str, str, Row, int]] = []
        for name, path, kind in (
            ("teacher, 40 steps", data / "teacher", "diffusion"),
            ("offline teacher", data / "offline" / "teacher", "diffusion"),
            ("regression", data / "regression", "student"),
            ("regression, 167 ms ahead", data / "lookahead" / "regression", "student"),
        ):
            if not self._trained(name, path):
                continue
            model, card = load_denoiser(path, kind)
            heard = audio
            if card.get("lookahead"):
                encode = evaluation.whole(self.encoder)
                heard = evaluation.features(segments, encode, card["lookahead"])
            row = (
                evaluation.teacher_row(model, audio, gaze, guidance)
                if kind == "diffusion"
                else evaluation.student_row(model, heard, gaze)
            )
            rows.append((GT, name, row, draws if kind == "diffusion" else 1))
        folder = data / "centred"
        if self._trained("non-causal encoder", folder / "student"):
            encoder = load_encoder(folder / "audio")
            assert isinstance(encoder, CentredEncoder)
            heard = evaluation.features(segments, lambda sound: fed_causally(encoder, sound, 800))
            model, _ = load_denoiser(folder / "student", "student")
            row = evaluation.without_outpainting_row(model, heard, None)
            rows.append((LIVE, "non-causal encoder, no outpainting", row, draws))
        return rows

    def _trained(self, name: str, path: Path) -> bool:
        if path.with_suffix(".json").is_file():
            return True
        if name not in self.missing:
            self.missing.append(name)
        return False

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
                self.driver, segments, self._truth(segments), self.mesh, settings.seed
            )
        return result

    def save_plots(self, folder: Path) -> list[Path]:
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
                for rows in (row(0), self._truth(segments))
            )
            shifts[kind] = eval_plots.shift_errors(guess, real)
        weights = self.settings.weights or inference.WEIGHTS
        cards = [*sorted(weights.glob("*.json")), *sorted(self.data.glob("*.json"))]
        cards += sorted(self.data.glob("*/teacher.json"))
        return eval_plots.save(folder, shifts, eval_plots.curves_of(cards))
