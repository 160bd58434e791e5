"""What a newcomer types first."""

import subprocess
import sys

import pytest

from app.main import main


@pytest.mark.parametrize(
    ("words", "said"), [([], "livedrive devices"), (["--version"], "livedrive 0.")]
)
def test_no_words_and_version(
    words: list[str],
    said: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(sys, "argv", ["livedrive", *words])
    main()
    assert said in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.parametrize(
    "words", ["run", "replay", "record", "calibrate", "bench", "capture", "train", "call host"]
)
def test_help_shows_no_python(words: str) -> None:
    """Red before: `--out {None}|PATH`."""
    program = [sys.executable, "-c", "from app.main import main; main()"]
    done = subprocess.run(
        [*program, *words.split(), "-h"], capture_output=True, text=True, check=True
    )
    assert "{None}|PATH" not in done.stdout and "{None}|FLOAT" not in done.stdout
