"""The models that `livedrive eval speech` judges, and those of DATA that ship with nobody."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from app.eval.speech.settings import SpeechSettings
from app.eval.speech.tables import GT, LIVE

if TYPE_CHECKING:
    from encoder.evaluation.rows import Row, Segment


class SpeechModels:
    """All models of one evaluation, its clips and the face."""

    def __init__(self, data: Path, settings: SpeechSettings) -> None:
        import torch

        from app.face.mesh import face_mesh
        from encoder import inference
        from encoder.evaluation.rows import held_out_segments
        from render.decoder.decoder import Decoder

        torch.set_num_threads(1)
        self.data, self.settings, self.missing = data, settings, list[str]()
        self.facts: dict[str, Any] = {}  # of rows, for the report
        self.kinds = held_out_segments(data, settings.segments, settings.seed)
        self.mesh, self.decoder = face_mesh(settings.avatar), Decoder.load()
        networks, self.card = inference.load_networks(settings.weights)
        self.encoder, self.student = networks.modules()
        self.driver = inference.load_driver(settings.weights, "cpu")

    def truth(self, segments: "list[Segment]") -> np.ndarray:  # [S, 100, 256]
        return self.decoder.encode(np.stack([segment.rig for segment in segments]))

    def trained_rows(
        self, segments: "list[Segment]", audio: Any, gaze: Any
    ) -> "list[tuple[str, str, Row, int]]":
        """Rows of models that are not shipped: teacher and ablations, where they were trained."""
        from encoder.denoiser.diffusion import Guidance
        from encoder.evaluation import rows as evaluation
        from encoder.training.checkpoints import load_denoiser

        data, draws = self.data, self.settings.samples
        guidance = Guidance(**self.card.get("guidance", {}))
        rows: list[tuple[str, str, Row, int]] = []
        for name, path, kind in (
            ("teacher, 40 steps", data / "teacher", "diffusion"),
            ("offline teacher", data / "offline" / "teacher", "diffusion"),
            ("regression", data / "regression", "student"),
            ("regression, 167 ms ahead", data / "lookahead" / "regression", "student"),
        ):
            if not self.trained(name, path):
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
        return rows + self.non_causal_rows(segments)

    def non_causal_rows(self, segments: "list[Segment]") -> "list[tuple[str, str, Row, int]]":
        """Table 2's first row, where it was trained."""
        from encoder.evaluation import rows as evaluation
        from encoder.training.centred import CentredEncoder, fed_causally
        from encoder.training.checkpoints import load_denoiser, load_encoder

        folder, draws = self.data / "centred", self.settings.samples
        rows: list[tuple[str, str, Row, int]] = []
        if self.trained("non-causal encoder", folder / "student"):
            encoder = load_encoder(folder / "audio")
            assert isinstance(encoder, CentredEncoder)
            heard = evaluation.features(segments, lambda sound: fed_causally(encoder, sound, 800))
            model, _ = load_denoiser(folder / "student", "student")
            row = evaluation.without_outpainting_row(model, heard, None)
            rows.append((LIVE, "non-causal encoder, no outpainting", row, draws))
        return rows

    def trained(self, name: str, path: Path) -> bool:
        if path.with_suffix(".json").is_file():
            return True
        if name not in self.missing:
            self.missing.append(name)
        return False
