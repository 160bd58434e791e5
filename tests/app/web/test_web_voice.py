"""Sound through Chromium drives the head exactly as the same sound in a session does."""

from collections.abc import Iterator
from pathlib import Path
from time import monotonic
from typing import Any

import numpy as np
import pytest
import soundfile
from browser import chromium, open_page
from web_client import PATIENCE_S, Talker, serving, wait_until

from app.web.microphone import WebMicrophone
from encoder.driver import Driver
from encoder.inference import load_driver
from render.decoder.decoder import Decoder
from sensors.assemble import Assembler
from sensors.clock import MonotonicClock
from sensors.live.source import LiveSource
from sensors.session import files as session
from sensors.session.recording import Recording
from sensors.standins.pulse import PulseServer
from sensors.types import FPS, SAMPLE_RATE, SAMPLES_PER_FRAME, SensorFrame

pytestmark = pytest.mark.slow

SMOKE = Path(__file__).parents[3] / "recordings" / "smoke" / "audio.wav"
SECONDS = 2
ENOUGH = 15  # frames of speech that must come through unbroken


@pytest.fixture
def pulse(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[PulseServer]:
    settings = tmp_path / "daemon.conf"
    settings.write_text(f"default-sample-rate = {SAMPLE_RATE}\n")
    monkeypatch.setenv("PULSE_CONFIG", str(settings))
    server = PulseServer(tmp_path / "pulse")
    server.start()
    yield server
    server.close()


@pytest.fixture(scope="module")
def driver() -> Driver:
    return load_driver(device="cpu")


def codes(driver: Driver, frames: list[SensorFrame]) -> np.ndarray:
    state, out = driver.init_state(0), []
    for frame in frames:
        driven, state = driver.step(frame, state)
        out.append(np.concatenate([driven.expression, driven.gaze.ravel()]))
    return np.array(out)


def test_a_wav_before_the_pages_microphone_drives_the_head_as_in_a_session(
    pulse: PulseServer, driver: Driver, decoder: Decoder, tmp_path: Path
) -> None:
    speech = soundfile.read(SMOKE, dtype="float32", frames=SECONDS * SAMPLE_RATE)[0]
    wav = np.rint(speech * 32767).astype(np.int16)
    # Chromium's floats: a positive full scale is 32767, a negative one 32768.
    scale = np.where(wav > 0, np.float32(1 / 32767), np.float32(1 / 32768))
    expected = wav.astype(np.float32) * scale
    with (
        serving(decoder, microphone=True, gaussians="16k") as talker,
        chromium(**pulse.environment) as browser,
    ):
        page = open_page(browser, talker.address, 64, 64)
        wait_until(lambda: not page.evaluate("document.getElementById('microphone').hidden"))
        page.evaluate("document.getElementById('microphone').click()")
        wait_until(lambda: chunks(talker) > 100)
        end = monotonic() + PATIENCE_S
        while True:
            live = listen(page, talker, pulse, wav)
            start, whole = unbroken(live, expected)
            if whole - start // SAMPLES_PER_FRAME >= ENOUGH:
                break
            assert monotonic() < end, f"{ENOUGH} frames did not come through"
        assert page.problems == []
    path = tmp_path / "same.wav"
    same = np.concatenate([np.zeros(start, np.float32), expected])
    soundfile.write(path, same, SAMPLE_RATE, subtype="FLOAT")
    session.create(tmp_path / "session", path)
    with Recording(tmp_path / "session") as recording:
        recorded = list(session.replay_frames(recording))
    np.testing.assert_array_equal(codes(driver, live[:whole]), codes(driver, recorded[:whole]))
    assert np.ptp(codes(driver, live[:whole])[:, :256], axis=0).max() > 0.05  # it did speak


def unbroken(live: list[SensorFrame], wav: np.ndarray) -> tuple[int, int]:
    """Where the wav starts, in samples, and how many whole frames come before a first loss.

    A busy machine may lose sound on its way through player, sound server and browser, where no page
    can tell; what is lost from the page on is the matter of test_web_sound.py.
    """
    heard = np.concatenate([frame.audio for frame in live])
    start = place(heard, wav)
    if start < 0:
        return 0, 0
    same = np.concatenate([np.zeros(start, np.float32), wav])
    count = min(len(heard), len(same))
    differ = np.flatnonzero(heard[:count] != same[:count])
    first = int(differ[0]) if len(differ) else count
    return start, first // SAMPLES_PER_FRAME


def chunks(talker: Talker) -> int:
    return (talker.count("microphone") or {"chunks": 0})["chunks"]  # type: ignore[index, return-value]


def listen(page: Any, talker: Talker, pulse: PulseServer, wav: np.ndarray) -> list[SensorFrame]:
    """What a loop that begins now gets while `wav` is played before the page's microphone."""
    frames, assembler = list[SensorFrame](), Assembler()
    source = LiveSource(WebMicrophone(talker.link, MonotonicClock()), [], MonotonicClock())
    source.open()

    def has(count: int) -> bool:
        for packet in source.poll():
            assembler.push(packet)
        frames.extend(assembler.ready())
        page.wait_for_timeout(5)
        return len(frames) > count

    wait_until(lambda: has(FPS))
    before, player = len(frames), pulse.play(wav)
    wait_until(lambda: has(before + FPS * (SECONDS + 1)) and player.poll() is not None)
    source.close()
    return frames


def place(heard: np.ndarray, wav: np.ndarray) -> int:
    """Where in `heard` the first sample of `wav` lies, found by its first 10 ms of sound; or -1."""
    mark = int(np.flatnonzero(np.abs(wav) > 0.02)[0])
    starts = np.flatnonzero(heard == wav[mark])
    found = [k for k in starts if np.array_equal(heard[k : k + 480], wav[mark : mark + 480])]
    if not found:
        return -1
    assert not heard[: int(found[0]) - mark].any()  # nothing but silence before it
    return int(found[0]) - mark
