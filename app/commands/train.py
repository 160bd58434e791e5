"""`livedrive train STAGE`: composes the training scripts with the decoder they need."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from tyro.conf import Positional

from app.terminal.arguments import Amount, File, Number
from app.train.settings import Preset, Stage, TrainSettings, Variant


@dataclass(kw_only=True)
class Train:
    """Train one stage; each resumes with --resume and stops safely on Ctrl-C.

    Order: audio, diffusion, distill, contact (shuts the student's lips); then gaze (a graph), eyes,
    multimodal; emotion; listen (the whole chain hears phones too), and contact again. On several
    GPUs or machines start it with torchrun.
    """

    stage: Positional[Stage]
    preset: Preset = "default"
    variant: Variant = "none"
    """An ablation of the paper, kept in its own folder of the data: `centred` audio encoder,
    `offline` teacher with full attention, regression with a `lookahead` of 5 frames, losses left
    out or jitter not normalised; emotion by `fine-tune` of every weight without L_lip, or with
    it, or without L_lip alone."""
    leave_out: tuple[str, ...] = ()
    """diffusion, distill, listen, contact: talkers whose motion is not learned from, e.g. grid-s2;
    weights go to DATA/leave_out, where `eval speech --leave-one-out` finds them."""
    teacher: File = None
    """audio: the viseme network's ONNX file, which teaches of voices without text."""
    phones: File = None
    """listen: folder of a phonetic encoder that `train audio --out` wrote; default: the shipped."""
    resume: bool = False
    """Go on from the last state of this run."""
    start: File = None
    """Folder with weights of the same shapes to start from; listen: with the chain to extend;
    contact and emotion: with the student to extend; emotion: and with convolutions to go on from
    where it has some."""
    steps: Number = None
    """Instead of the preset's."""
    face: Path = Path("face")
    """prior: folder of the face data."""
    take: File = None
    """prior: a Live Link Face table; its first part is learned from, the rest is held out."""
    data: Path = Path("data")
    """Data pack that `livedrive capture` made."""
    stream_minutes: Amount = None
    """Minutes of sound that a stage after audio learns from, instead of its own."""
    out: File = None
    """Where weights go; default: beside the code, where the app looks for them."""
    seed: int = 0
    device: Literal["cpu", "cuda"] = "cpu"
    precision: Literal["float32", "bfloat16"] = "float32"
    compile: bool = False
    """Fuse kernels first (minutes); pays on a GPU."""

    def run(self) -> None:
        if self.stage == "prior":
            from render.decoder.learned import weights_file
            from render.training import prior

            out = self.out or weights_file.FOLDER
            work = self.data / f"prior_{self.preset}"
            prior.run(self.face, out, self.preset, work, self.take, self.seed)
        else:
            from app.train.stages import run_stage

            settings = TrainSettings(
                stage=self.stage,
                preset=self.preset,
                variant=self.variant,
                leave_out=self.leave_out,
                teacher=self.teacher,
                phones=self.phones,
                resume=self.resume,
                start=self.start,
                steps=self.steps,
                data=self.data,
                stream_minutes=self.stream_minutes,
                out=self.out,
                seed=self.seed,
                device=self.device,
                precision=self.precision,
                compile=self.compile,
            )
            run_stage(settings)
