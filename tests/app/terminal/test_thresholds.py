"""Reports of evals and benches as files."""

import json
from pathlib import Path

from app.terminal import thresholds


def test_what_could_not_be_measured_is_null(tmp_path: Path) -> None:
    """Red before: Infinity, which is no JSON."""
    rows = [thresholds.at_most("lips", float("inf"), 20.0), thresholds.at_least("r", 0.5, 0.4)]
    path = tmp_path / "r.json"
    thresholds.write({"metrics": {"lips": float("nan"), "r": 0.5}, "bars": rows}, path)
    found = json.loads(path.read_text(), parse_constant=lambda word: 1 / 0)
    assert found["metrics"] == {"lips": None, "r": 0.5}
    assert [row["ok"] for row in found["bars"]] == [False, True]
