"""`livedrive train STAGE`: composes the training scripts with the decoder they need."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from tyro.conf import Positional

Stage = Literal["prior", "audio", "diffusion", "distill"]


@dataclass(kw_only=True)
class Train:
    """Train one stage; each resumes with --resume and stops safely on Ctrl-C."""

    stage: Positional[Stage]
    preset: Literal["debug", "default", "paper"] = "default"
    resume: bool = False
    """Go on from the last state of this run."""
    face: Path = Path("face")
    """prior: folder of the face data."""
    data: Path = Path("data")
    """Data pack that `livedrive capture` made."""
    out: Path | None = None
    """Where weights go; default: beside the code, where the app looks for them."""
    seed: int = 0

    def run(self) -> None:
        if self.stage == "prior":
            from render import weights_file
            from render.training import prior

            prior.run(self.face, self.out or weights_file.FOLDER, seed=self.seed)
        else:
            from app.training import run_stage

            run_stage(self)
