"""Options that evaluations share."""

from dataclasses import dataclass

from app.terminal.arguments import File, Seed


@dataclass(frozen=True, kw_only=True)
class ReportSettings:
    seed: Seed = 0
    """Seed of whatever is drawn at random."""
    report: File = None
    """Write the metrics as JSON."""


@dataclass(frozen=True, kw_only=True)
class EvalSettings(ReportSettings):
    """Of all evaluations of a driven head."""

    avatar: str = "ben"
    """Avatar on which to measure."""
