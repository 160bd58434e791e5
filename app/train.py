"""`livedrive train STAGE`: composes the training scripts with the decoder they need."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from tyro.conf import Positional

Stage = Literal[
    "prior", "audio", "diffusion", "distill", "contact", "regression", "gaze", "eyes", "multimodal",
    "emotion",
]  # fmt: skip
Variant = Literal[
    "none", "centred", "offline", "lookahead", "no-velocity", "no-jitter", "plain-jitter", "no-dmd",
    "fine-tune", "no-lip",
]  # fmt: skip


@dataclass(kw_only=True)
class Train:
    """Train one stage; each resumes with --resume and stops safely on Ctrl-C.

    Order: audio, diffusion, distill, contact (shuts the student's lips); then gaze (a graph), eyes,
    multimodal; emotion. On several GPUs or machines start it with torchrun.
    """

    stage: Positional[Stage]
    preset: Literal["debug", "default", "paper"] = "default"
    variant: Variant = "none"
    """An ablation of the paper, kept in its own folder of the data: `centred` audio encoder,
    `offline` teacher with full attention, regression with a `lookahead` of 5 frames, losses left
    out or jitter not normalised; emotion by `fine-tune` of every weight, or without L_lip."""
    resume: bool = False
    """Go on from the last state of this run."""
    start: Path | None = None
    """Folder with weights of the same shapes to start from; contact and emotion: with the student
    to extend; emotion: and with convolutions to go on from where it has some."""
    steps: int | None = None
    """Instead of the preset's."""
    face: Path = Path("face")
    """prior: folder of the face data."""
    take: Path | None = None
    """prior: a Live Link Face table; its first part is learned from, the rest is held out."""
    data: Path = Path("data")
    """Data pack that `livedrive capture` made."""
    stream_minutes: float | None = None
    """Minutes of sound that a stage after audio learns from, instead of its own."""
    out: Path | None = None
    """Where weights go; default: beside the code, where the app looks for them."""
    seed: int = 0
    device: Literal["cpu", "cuda"] = "cpu"
    precision: Literal["float32", "bfloat16"] = "float32"
    compile: bool = False
    """Fuse kernels first (minutes); pays on a GPU."""

    def run(self) -> None:
        if self.stage == "prior":
            from render import weights_file
            from render.training import prior

            out = self.out or weights_file.FOLDER
            work = self.data / f"prior_{self.preset}"
            prior.run(self.face, out, self.preset, work, self.take, self.seed, self.device)
        else:
            from app.training import run_stage

            run_stage(self)
