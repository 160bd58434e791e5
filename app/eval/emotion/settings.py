"""What `livedrive eval emotion` is asked to do, and the names of its rows."""

from dataclasses import dataclass

from app.eval.settings import EvalSettings
from app.terminal.arguments import File

# rows: trained models, and the neutral one's lips in the rules' style (see laid_over)
FINE_TUNED, SHIPPED, RULES = "fine-tuned", "zero convolutions", "rules over neutral"


@dataclass(frozen=True, kw_only=True)
class EmotionSettings(EvalSettings):
    """Evaluate emotions on held-out subjects: recognised, in sync, smooth."""

    weights: File = None
    """Folder with weights of audio encoder, student and emotions; default: the shipped ones."""
    segments: int = 40
    """At most so many neutral takes (200 frames of each) and 100-frame segments of real voices."""
    samples: int = 2
    """Samples drawn for each."""
    pictures: File = None
    """Folder for pictures: frames of every emotion, confusion tables."""
