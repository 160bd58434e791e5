"""What a newcomer types first."""

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
