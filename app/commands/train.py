"""`livedrive train STAGE`: composes the training scripts with the decoder they need."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional

from app.terminal.arguments import Amount, File, Number, Seed, optional
from app.train.settings import Baseline, Preset, Stage, TrainSettings, Variant


@dataclass(kw_only=True)
class Train:
    """Train one stage; Ctrl-C stops it safely, --resume continues.

    Order: audio, diffusion, distill, contact (closes the student's lips); then gaze (a graph),
    eyes, multimodal; emotion; listen (the whole chain also hears phones, with a contact head anew),
    voice-activity (its lips rest in more sounds that are no voice).
    Start it with torchrun on several GPUs or machines.
    """

    stage: Positional[Stage]
    """What to train; `prior` is the Gaussian head, the others are networks of the encoder, but for
    `landmarks`: a table of where the detector's points of `avatar create --photos` lie."""
    preset: Preset = "default"
    """Sizes and steps: debug (seconds), default (what ships) or paper."""
    variant: Variant = "none"
    """An ablation of the paper, kept in a folder of its own under --data: a student with nothing
    left out (`plain`), a `centred` audio encoder, which hears ahead, and a `causal` one trained
    as long, an `offline` teacher with full attention, regression with a `lookahead` of 5 frames,
    a loss left out (`no-...`), jitter not normalised (`plain-jitter`), or, for emotion, all
    weights trained instead of the added layer (`fine-tune`, `fine-tune-lip` with L_lip)."""
    name: Annotated[Baseline | None, optional("talkshow|audio2photoreal|diffposetalk")] = None
    """peers: which of the paper's baselines (table 1) to train a twin of; it goes to DATA/peers,
    for `eval speech --peers`."""
    leave_out: tuple[str, ...] = ()
    """diffusion, distill, listen, voice-activity, contact: talkers to keep out of training, e.g.
    grid-s2; weights go to DATA/leave_out, where `eval speech --leave-one-out` finds them."""
    teacher: File = None
    """audio: ONNX file of a viseme network, the teacher on recordings without a transcript."""
    phones: File = None
    """listen: folder of a phonetic encoder by `train audio --out`; default: the shipped one."""
    resume: bool = False
    """Continue from the last saved state."""
    start: File = None
    """Folder of weights to start from, of the same shapes; listen: of the chain to extend;
    contact, emotion, voice-activity: of the student to extend, and, if it has any, of the
    convolutions."""
    steps: Number = None
    """Training steps, instead of the preset's."""
    face: Path = Path("face")
    """prior, landmarks: folder of the face data."""
    take: File = None
    """prior: a Live Link Face table: training uses its first part, the rest is held out."""
    data: Path = Path("data")
    """Data pack that `livedrive capture` made."""
    stream_minutes: Amount = None
    """diffusion, distill, contact, regression, emotion, peers: minutes of sound to learn from,
    instead of the stage's default."""
    out: File = None
    """Folder for the weights; default: beside the code, where the app looks for them."""
    seed: Seed = 0
    """Seed of the first weights, of batches and noise."""
    device: Literal["cpu", "cuda"] = "cpu"
    """Where to train."""
    precision: Literal["float32", "bfloat16"] = "float32"
    """Of the forward and backward pass; weights stay float32."""
    compile: bool = False
    """Compile the networks first: takes minutes, pays off on a GPU."""

    def run(self) -> None:
        from app.train.next_step import next_command
        from app.train.stages import run_stage
        from encoder.training import parallel

        settings = TrainSettings(
            stage=self.stage,
            preset=self.preset,
            variant=self.variant,
            name=self.name,
            leave_out=self.leave_out,
            teacher=self.teacher,
            phones=self.phones,
            resume=self.resume,
            start=self.start,
            steps=self.steps,
            face=self.face,
            take=self.take,
            data=self.data,
            stream_minutes=self.stream_minutes,
            out=self.out,
            seed=self.seed,
            device=self.device,
            precision=self.precision,
            compile=self.compile,
        )
        run_stage(settings)
        if self.stage != "landmarks" and parallel.join(settings.device).leads:
            print(f"next: {next_command(settings)}")
