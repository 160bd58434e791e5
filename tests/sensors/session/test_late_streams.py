"""Videos whose streams begin at different times, or whose pictures are not evenly spread."""

from fractions import Fraction
from itertools import islice
from pathlib import Path

import av
import numpy as np
import pytest
import soundfile

from sensors.cameras.video import file_pictures
from sensors.session import files as session
from sensors.session.recording import Recording
from sensors.types import NS, SAMPLE_RATE

LATE_S = Fraction(1, 2)


def film(path: Path, picture_s: list[Fraction], sound_s: Fraction) -> Path:
    """Grey pictures, picture k of value 8 k, and a second of loud sound from `sound_s` on."""
    with av.open(str(path), "w") as container:
        video = container.add_stream("ffv1", rate=30)
        video.width, video.height, video.pix_fmt = 400, 400, "gray"
        video.time_base = video.codec_context.time_base = Fraction(1, 1000)
        audio = container.add_stream("pcm_s16le", rate=SAMPLE_RATE)
        audio.layout = "mono"
        for k, at_s in enumerate(picture_s):
            frame = av.VideoFrame.from_ndarray(np.full((400, 400), 8 * k, np.uint8), format="gray")
            frame.pts, frame.time_base = round(at_s * 1000), Fraction(1, 1000)
            container.mux(video.encode(frame))
        container.mux(video.encode(None))
        for start in range(0, SAMPLE_RATE, 1600):
            chunk = np.full((1, 1600), 9000, np.int16)
            sound = av.AudioFrame.from_ndarray(chunk, format="s16", layout="mono")
            sound.sample_rate, sound.time_base = SAMPLE_RATE, Fraction(1, SAMPLE_RATE)
            sound.pts = round(sound_s * SAMPLE_RATE) + start
            container.mux(audio.encode(sound))
        container.mux(audio.encode(None))
    return path


@pytest.mark.parametrize("late", ["eyes", "sound"])
def test_what_begins_later_in_its_file_stays_later(late: str, tmp_path: Path) -> None:
    """Red before: both began at once."""
    first_s, sound_s = (LATE_S, Fraction(0)) if late == "eyes" else (Fraction(0), LATE_S)
    path = film(tmp_path / "a.mkv", [first_s + Fraction(k, 30) for k in range(10)], sound_s)
    session.create(tmp_path / "s", audio=path, eyes=[path, path])
    with Recording(tmp_path / "s") as recording:
        first_ns = recording.eyes[0].t_ns[0]
        assert abs(first_ns - (first_s + Fraction(1, 30)) * NS) < 2_000_000
    sound, _ = soundfile.read(tmp_path / "s" / "audio.wav")
    assert abs(int(np.flatnonzero(sound > 0.1)[0]) - sound_s * SAMPLE_RATE) < 100


def test_a_video_plays_at_its_own_times(tmp_path: Path) -> None:
    """Red before: evenly, at the mean rate."""
    times = [Fraction(k, 20) if k < 6 else Fraction(k, 5) - Fraction(9, 10) for k in range(10)]
    path = film(tmp_path / "a.mkv", times, Fraction(0))
    shown = [t_ns / NS for t_ns, _ in islice(file_pictures(path), 12)]
    assert np.allclose(shown[:10], [float(t) for t in times], atol=1e-3)
    assert shown[10] > shown[9] and shown[11] - shown[10] == pytest.approx(0.05, abs=1e-3)
