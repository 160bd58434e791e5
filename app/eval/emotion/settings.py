"""What `livedrive eval emotion` is asked to do, and the names of its rows."""

from dataclasses import dataclass
from pathlib import Path

# rows: trained models, and the neutral one's lips in the rules' style (see laid_over)
FINE_TUNED, SHIPPED, RULES = "fine-tuned", "zero convolutions", "rules over neutral"


@dataclass(frozen=True, kw_only=True)
class EmotionSettings:
    """Judge emotions on held-out subjects: recognised, in sync, smooth."""

    weights: Path | None = None
    """Folder with audio, student and emotion; default: the shipped ones."""
    segments: int = 40
    """Most neutral takes (of each the first 200 frames) and 100-frame segments of real voices."""
    samples: int = 2
    """Draws of each."""
    avatar: str = "ben"
    seed: int = 0
    report: Path | None = None
    """Write the metrics as JSON."""
    pictures: Path | None = None
    """Folder for pictures: emotions x frames, confusion tables."""
