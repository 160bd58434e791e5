"""Options shared by all evaluations of a driven head."""

from dataclasses import dataclass

from app.terminal.arguments import File


@dataclass(frozen=True, kw_only=True)
class EvalSettings:
    avatar: str = "ben"
    """Avatar on which to measure."""
    seed: int = 0
    """Seed of whatever is drawn at random."""
    report: File = None
    """Write the metrics as JSON."""
