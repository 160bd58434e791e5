"""Where heard sound lies in what was said, on sounds whose delays are known."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import soundfile

from app.call.media.opus import LOOK_AHEAD, PACKET, OpusDecoder, OpusEncoder
from app.call.trial.track import WINDOW, Matches, matches, track
from sensors.types import NS, SAMPLE_RATE

RECORDING = Path(__file__).parents[3] / "recordings" / "demo" / "audio.wav"
SPEECH = soundfile.read(RECORDING, dtype="float32")[0]
SEARCH = SAMPLE_RATE // 2


def through_opus(sound: np.ndarray) -> np.ndarray:
    encoder, decoder = OpusEncoder(), OpusDecoder()
    whole = sound[: len(sound) // PACKET * PACKET].reshape(-1, PACKET)
    return np.concatenate([decoder.decode(encoder.encode(packet)) for packet in whole])


def windows_of(heard: np.ndarray) -> list[Matches]:
    """Of sound that is heard from second 1 on, 0 to 500 ms late."""
    found = list[Matches]()
    for at in range(0, len(heard) - WINDOW + 1, WINDOW):
        said = SPEECH[SAMPLE_RATE + at - SEARCH : SAMPLE_RATE + at + WINDOW].astype(float)
        middles, alike = matches(heard[at : at + WINDOW].astype(float), said)
        if len(middles):
            late_ms = (SEARCH + WINDOW / 2 - middles) * 1e3 / SAMPLE_RATE
            found.append(Matches(NS + (at + WINDOW / 2) * NS / SAMPLE_RATE, late_ms, alike))
    return found


def there_and_back(t: np.ndarray) -> np.ndarray:
    """s; 0.6 % faster for two seconds, then slower, and so on."""
    return 0.1 + 0.006 * np.abs(t % 4 - 2)


def by_steps(t: np.ndarray) -> np.ndarray:
    """s; as a call adapts: at 2 % to another delay, and rests there."""
    at = [1, 2.3, 3.3, 6, 6.8, 9, 9.6, 12, 12.9, 20]
    return np.interp(t, at, np.array([60, 60, 78, 78, 66, 66, 60, 60, 78, 78]) / 1e3)


@pytest.mark.slow
@pytest.mark.parametrize(("late", "within_ms"), [(there_and_back, 2), (by_steps, 1)])
def test_a_voice_is_not_followed_to_another_period_of_its_pitch(
    late: Callable[[np.ndarray], np.ndarray], within_ms: float
) -> None:
    """Red before: where the delay adapts, what Opus leaves of a voice is most alike a period off in
    some windows, two in a row too."""
    t = 1 + np.arange(len(SPEECH) - SAMPLE_RATE) / SAMPLE_RATE
    played = through_opus(SPEECH)
    heard = np.interp((t - late(t)) * SAMPLE_RATE + LOOK_AHEAD, np.arange(len(played)), played)
    windows = windows_of(heard)
    rows = track(windows)
    likeliest = np.array([(w.t_ns, w.late_ms[0]) for w in windows])
    worst, before = (np.abs(r[:, 1] - 1e3 * late(r[:, 0] / NS)).max() for r in (rows, likeliest))
    assert worst < within_ms and before > 5 and len(rows) > 0.9 * len(windows)


def one(at: int, *late_ms: float, less: float = 0.02) -> Matches:
    """The `at`th window: each place is less alike than the one before."""
    alike = 0.9 - less * np.arange(len(late_ms))
    return Matches(NS + at * NS / 4, np.array(late_ms), alike)


def test_the_smoothest_of_places_alike() -> None:
    """Two windows in a row are a period off, one fits nowhere; what adapts at 2 %, or jumps for
    good, stays."""
    windows = [one(0, 66.4), one(1, 72.6, 66.3), one(2, 60.1, 66.5), one(3, 74.5), one(4, 66.5)]
    windows += [one(5 + k, late_ms) for k, late_ms in enumerate((70, 74, 78, 82, 82, 60, 60, 60))]
    told = track(windows)
    np.testing.assert_array_equal(
        told[:, 1], [66.4, 66.3, 66.5, 66.5, 70, 74, 78, 82, 82, 60, 60, 60]
    )
    for few in (0, 1, 2):
        assert len(track(windows[:few])) == few


def test_a_jump_for_a_second_that_the_sound_tells_clearly_is_believed() -> None:
    windows = [one(k, 66.0, 72.0) for k in range(4)]
    windows += [one(4 + k, 81.0, 66.0, less=0.2) for k in range(4)]
    windows += [one(8 + k, 66.0, 72.0) for k in range(4)]
    np.testing.assert_array_equal(track(windows)[:, 1], [66.0] * 4 + [81.0] * 4 + [66.0] * 4)
