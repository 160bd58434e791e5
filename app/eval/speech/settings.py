"""What `livedrive eval speech` is asked to do."""

from dataclasses import dataclass

from app.eval.settings import EvalSettings
from app.terminal.arguments import Count, File


@dataclass(frozen=True, kw_only=True)
class SpeechSettings(EvalSettings):
    """Evaluate audio encoder, teacher and student on held-out clips, silence and noise."""

    weights: File = None
    """Folder with the weights of audio encoder and student; default: the shipped ones."""
    speech: File = None
    """Folder of further speech recordings, not used in training."""
    every: Count = 1
    """Use only every n-th of them."""
    samples: Count = 5
    """Samples drawn for each row (the paper: 5)."""
    segments: Count = 48
    """Most segments of 100 frames of each kind of clip."""
    brief: bool = False
    """Only the shipped student: no teacher, no ablations, no ten-minute run."""
    leave_one_out: bool = False
    """Instead: evaluate each talker of --mocap with the student in DATA/leave_out that was trained
    without that talker (`livedrive train distill --leave-out TALKER`)."""
    mocap: File = None
    """Folder of tracked faces, for --leave-one-out."""
    peers: File = None
    """Instead: table 1, ours beside the twins in this folder (`livedrive train peers`)."""
    films: File = None
    """With --peers, instead of tables: folder for films of 24 clips of ours and of each twin, and
    a page for each twin to vote on."""
    ablations: bool = False
    """Instead: the paper's ablations (tables 2 and 3, losses), of what was trained in DATA."""
    strips: File = None
    """With --leave-one-out, instead of tables: folder for pictures of eight voices' mouths at named
    phones, shown and tracked."""
    plots: File = None
    """Folder for plots: loss curves, and the error over a constant shift; with --leave-one-out,
    what lips and teeth do for each class of phones."""
