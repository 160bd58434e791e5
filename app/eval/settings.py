"""What the evaluations of driven heads have in common."""

from dataclasses import dataclass

from app.terminal.arguments import File


@dataclass(frozen=True, kw_only=True)
class EvalSettings:
    avatar: str = "ben"
    """Avatar to measure on."""
    seed: int = 0
    """Seed of whatever is drawn at random."""
    report: File = None
    """Write the metrics as JSON."""
