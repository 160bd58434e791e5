"""`livedrive eval speech DATA`: the paper's tables 1-3 and what a causal model must show besides.

Rows keep the paper's three settings apart: the recorded gaze, a synthesised gaze, and the live
path. A row whose model was not trained (see `livedrive train --variant`) is left out and named.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from tyro.conf import Positional

from app.eval_tables import GT, LIVE, SYNTHESISED, Figures, make_bars, show

if TYPE_CHECKING:
    from encoder.evaluation import Row, Segment


@dataclass(kw_only=True)
class EvalSpeech:
    """Judge the audio encoder, teacher and student on held-out clips, silence and noise."""

    data: Positional[Path]
    """Data that `livedrive capture` made; the teacher and ablations are looked for in it."""
    weights: Path | None = None
    """Folder with audio and student; default: the shipped ones."""
    speech: Path | None = None
    """Also a folder of speech recordings that were not used in training."""
    every: int = 1
    """Use every n-th of those recordings."""
    samples: int = 5
    """Draws of each row (the paper: 5)."""
    segments: int = 24
    """Most 100-frame segments of each kind of clip."""
    brief: bool = False
    """Only what the shipped student needs: no teacher, ablations or ten minutes."""
    avatar: str = "ben"
    seed: int = 0
    report: Path | None = None
    """Write the figures as JSON."""
    plots: Path | None = None
    """Folder for pictures: loss curves of all cards, error over a constant shift."""

    def run(self) -> None:
        from app.bars import finish

        judged = Judgement(self)
        tables = judged.tables()
        metrics = judged.live_figures() | {
            f"{kind}/{setting}/{row}/{name}": value
            for kind, settings in tables.items()
            for setting, rows in settings.items()
            for row, figures in rows.items()
            for name, value in figures.items()
        }
        show(tables)
        for name, value in metrics.items():
            if "/" not in name:
                print(f"{name:36s} {value:.3f}")
        for name in judged.missing:
            print(f"not trained, row left out: {name}")
        if self.plots:
            for path in judged.save_plots(self.plots):
                print(f"wrote {path}")
        bars = make_bars(metrics)
        if self.report:
            rounded = {name: round(value, 4) for name, value in metrics.items()}
            report = {"metrics": rounded, "bars": bars, "seed": self.seed, "avatar": self.avatar}
            report |= {"samples": self.samples, "segments": self.segments}
            report |= {"test_set": str(self.data), "not_trained": judged.missing}
            self.report.write_text(json.dumps(report, indent=2) + "\n")
        finish(bars)


class Judgement:
    """All models of one evaluation, and the rows they give."""

    def __init__(self, command: EvalSpeech) -> None:
        import torch

        from app.face_mesh import face_mesh
        from encoder import inference
        from encoder.evaluation import held_out_segments
        from render.decoder import Decoder

        torch.set_num_threads(1)
        self.command, self.missing = command, list[str]()
        self.mesh, self.decoder = face_mesh(command.avatar), Decoder.load()
        self.encoder, self.student, self.card = inference.load_models(command.weights)
        self.driver = inference.load_driver(command.weights, "cpu")
        self.kinds = held_out_segments(command.data, command.segments, command.seed)

    def tables(self) -> dict[str, dict[str, dict[str, Figures]]]:
        """kind of clip -> setting -> row -> figures."""
        from tqdm import tqdm

        return {
            kind: self._table(segments)
            for kind, segments in tqdm(self.kinds.items(), unit="kind", disable=None)
        }

    def _table(self, segments: "list[Segment]") -> dict[str, dict[str, Figures]]:
        from encoder.judging import Truth, judge

        codes = self._truth(segments)
        truth = Truth.of(segments, codes, self.mesh)
        result: dict[str, dict[str, Figures]] = {}
        for setting, name, row, draws in self._rows(segments):
            samples = [row(seed) for seed in range(draws)]
            result.setdefault(setting, {})[name] = judge(samples, truth, self.mesh)
        return result

    def _truth(self, segments: "list[Segment]") -> np.ndarray:  # [S, 100, 256]
        return self.decoder.encode(np.stack([segment.rig for segment in segments]))

    def _rows(self, segments: "list[Segment]") -> "list[tuple[str, str, Row, int]]":
        """(setting, name, row, number of draws)."""
        from app.eval_live import live_codes
        from encoder import evaluation
        from encoder.denoiser import headless

        draws = self.command.samples
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
        if self.command.brief:
            return rows
        bare = evaluation.without_outpainting_row(student, audio, None)
        rows.append((LIVE, "no outpainting", bare, draws))
        return rows + self._trained_rows(segments, audio, gaze)

    def _trained_rows(
        self, segments: "list[Segment]", audio: Any, gaze: Any
    ) -> "list[tuple[str, str, Row, int]]":
        """Rows of models that ship with nobody: teacher and ablations, where they were trained."""
        from encoder import evaluation
        from encoder.diffusion import Guidance
        from encoder.training.audio import load_encoder
        from encoder.training.centred import CentredEncoder, fed_causally
        from encoder.training.diffusion import load_denoiser

        data, draws = self.command.data, self.command.samples
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
        from encoder import evaluation
        from encoder.capture.channels import JAW_OPEN

        fit = evaluation.fit_energy_to_jaw(self.command.data, JAW_OPEN)
        rig = evaluation.energy_to_jaw_rig(segments, fit, JAW_OPEN)
        return lambda seed: self.decoder.encode(rig)

    def live_figures(self) -> Figures:
        """Silence, noise, real speech, ten minutes."""
        from app import eval_live

        command, result = self.command, eval_live.rest_figures(self.driver, self.mesh, 0)
        if command.speech:
            result |= eval_live.speech_figures(
                self.driver, self.mesh, command.speech, command.every, command.seed
            )
        if not command.brief and self.kinds:
            segments = max(self.kinds.values(), key=len)
            result |= eval_live.drift_figures(
                self.driver, segments, self._truth(segments), self.mesh, command.seed
            )
        return result

    def save_plots(self, folder: Path) -> list[Path]:
        """The student's error over shift for each kind of clip; loss curves of all cards."""
        from app import eval_plots
        from encoder import evaluation, inference

        shifts = {}
        for kind, segments in self.kinds.items():
            audio = evaluation.features(segments, evaluation.whole(self.encoder))
            row = evaluation.student_row(self.student, audio, evaluation.true_gaze(segments))
            guess, real = (
                [self.mesh.opening_mm(codes) for codes in rows]
                for rows in (row(0), self._truth(segments))
            )
            shifts[kind] = eval_plots.shift_errors(guess, real)
        weights = self.command.weights or inference.WEIGHTS
        cards = [*sorted(weights.glob("*.json")), *sorted(self.command.data.glob("*.json"))]
        cards += sorted(self.command.data.glob("*/teacher.json"))
        return eval_plots.save(folder, shifts, eval_plots.curves_of(cards))
