"""What a training stage is asked to do."""

from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import Literal

from sensors.types import InputError

Stage = Literal[
    "prior", "audio", "diffusion", "distill", "listen", "voice-activity", "contact", "regression",
    "gaze", "eyes", "wide-eyes", "multimodal", "emotion", "peers", "landmarks",
]  # fmt: skip
Variant = Literal[
    "none", "plain", "centred", "causal", "offline", "lookahead",
    "no-velocity", "no-jitter", "plain-jitter", "no-dmd",
    "fine-tune", "fine-tune-lip", "no-lip",
]  # fmt: skip
Preset = Literal["debug", "default", "paper"]
DEBUG_MINUTES = 2.0  # of sound, where `debug` is to take seconds
Baseline = Literal["talkshow", "audio2photoreal", "diffposetalk"]


@dataclass(frozen=True, kw_only=True)
class TrainSettings:
    """One stage of training; see `livedrive train -h`."""

    stage: Stage
    preset: Preset = "default"
    variant: Variant = "none"  # an ablation of the paper
    name: Baseline | None = None  # of the stage peers: whose twin
    leave_out: tuple[str, ...] = ()  # talkers whose motion is not learned from
    teacher: Path | None = None  # of the audio stage: the viseme network's ONNX file
    phones: Path | None = None  # of the stage listen: folder of a phonetic encoder
    resume: bool = False
    start: Path | None = None  # folder with weights to start from
    steps: int | None = None  # instead of the preset's
    face: Path = Path("face")  # of the stage prior: folder of the face data
    take: Path | None = None  # of the stage prior: a Live Link Face table
    data: Path = Path("data")  # data pack of `livedrive capture`
    stream_minutes: float | None = None  # of sound that a stage with streams learns from
    out: Path | None = None  # folder for weights; None: where the app looks for them
    seed: int = 0
    device: Literal["cpu", "cuda"] = "cpu"
    precision: Literal["float32", "bfloat16"] = "float32"
    compile: bool = False

    def __post_init__(self) -> None:
        """Raises InputError for no steps or no sound: weights without training would be written."""
        for option, value, wanted in (
            ("--steps", self.steps, "1 or more"),
            ("--stream-minutes", self.stream_minutes, "more than 0"),
        ):
            if value is not None and not 0 < value < inf:
                raise InputError(f"{option}: expected {wanted}, got {value:g}; leave it out")

    @property
    def folder(self) -> Path:
        """Of states and of weights that do not ship."""
        if self.leave_out:
            return self.data / "leave_out" / "+".join(self.leave_out)
        return self.data if self.variant == "none" else self.data / self.variant

    def minutes(self, usual: float) -> float:
        """Of sound that a stage learns from, `usual` being its default."""
        if self.stream_minutes is not None:
            return self.stream_minutes
        return DEBUG_MINUTES if self.preset == "debug" else usual
