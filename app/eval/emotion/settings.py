"""Options of `livedrive eval emotion`, and the names of its rows."""

from dataclasses import dataclass

from app.eval.settings import EvalSettings
from app.terminal.arguments import Count, File

# rows: two trained models, and the neutral model with the rules' style added (see laid_over)
FINE_TUNED, SHIPPED, RULES = "fine-tuned", "zero convolutions", "rules over neutral"


@dataclass(frozen=True, kw_only=True)
class EmotionSettings(EvalSettings):
    """Evaluate emotions on held-out subjects: recognition, lip sync and smoothness."""

    weights: File = None
    """Folder with weights of audio encoder, student and emotions; default: the shipped ones."""
    segments: Count = 40
    """Most neutral takes (200 frames of each) and most 100-frame segments of real voices."""
    samples: Count = 2
    """Samples drawn for each of them."""
    pictures: File = None
    """Folder for pictures: frames of every emotion, confusion tables."""
