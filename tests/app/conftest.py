"""What many tests of the app share: one person, a renderer, commands without a process."""

import io
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
import soundfile
from web_client import AVATAR

from app.main import main
from render.decoder import identity
from render.decoder.identity import Identity
from render.splats.renderer import create_renderer
from render.types import Renderer
from sensors.session import files
from sensors.types import SAMPLE_RATE

SPEECH = Path(__file__).parents[2] / "recordings" / "smoke" / "audio.wav"


@pytest.fixture(scope="session")
def who() -> Identity:
    return identity.load(AVATAR)


@pytest.fixture(scope="module")
def renderer() -> Iterator[Renderer]:
    made = create_renderer()
    yield made
    made.close()


@pytest.fixture
def second(tmp_path: Path) -> Path:
    """A session of a second of speech."""
    speech, _ = soundfile.read(SPEECH, frames=SAMPLE_RATE)
    soundfile.write(tmp_path / "second.wav", speech, SAMPLE_RATE)
    files.create(tmp_path / "second", tmp_path / "second.wav")
    return tmp_path / "second"


@dataclass(frozen=True)
class Ended:
    """As subprocess.CompletedProcess."""

    returncode: int
    stdout: str
    stderr: str


@pytest.fixture
def livedrive(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., Ended]:
    """Runs a command here: where no process is looked at, it need not import and load anew."""
    # which would take away the standard error of all later tests
    monkeypatch.setattr("sensors.audio.portaudio.silence_native_messages", lambda: None)

    def run(*words: str) -> Ended:
        monkeypatch.setattr(sys, "argv", ["livedrive", *words])
        monkeypatch.setattr(sys, "stdin", io.StringIO())  # nobody types
        status = 0
        try:
            main()
        except SystemExit as ended:
            assert isinstance(ended.code, int | None)
            status = ended.code or 0
        shown = capsys.readouterr()
        return Ended(status, shown.out, shown.err)

    return run
