"""A session as one MKV for any player: `livedrive session export`.

Flow: Recording -> ReplaySource -> assembled frames -> both eyes side by side, and the sound.
"""

from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Any, Literal

import numpy as np

from sensors import files
from sensors.clock import ManualClock
from sensors.session.files import frames_of, quiet
from sensors.session.format import check_apart
from sensors.session.recording import Recording
from sensors.session.replay import ReplaySource
from sensors.types import EYE_SIZE, FPS, SAMPLE_RATE, SAMPLES_PER_FRAME, InputError, SensorFrame


def export(
    folder: str | Path,
    out: str | Path,
    *,
    drop: Literal["audio", "eyes"] | None = None,
    progress: Callable[[float], object] = quiet,
) -> dict[str, Any]:
    """Write an MKV for any player: both eyes side by side (left first) with the sound.

    It shows the assembled 30 FPS frames, so what is seen is what the driver gets. `drop` leaves the
    voice or the eyes out, before the file is given to others. The result has `warnings`.
    """
    import av

    out = Path(out)
    if out.suffix.lower() != ".mkv":
        raise InputError(
            f"{out}: expected a name that ends in .mkv, got {out.suffix or 'none'!r}; "
            f"try {out.stem or 'out'}.mkv"
        )
    check_apart(Path(folder), out)
    with (
        files.all_or_nothing(),
        Recording(folder) as recording,
        files.replacing(out, private=True) as draft,
    ):
        recording.check_frames()
        shown = bool(recording.eyes) and drop != "eyes"
        if not shown and drop == "audio":
            raise InputError(f"{folder}: expected something to export, got a session without eyes")
        container: Any = av.open(str(draft), "w", format="matroska")
        picture: Any = None
        sound: Any = None
        if shown:
            picture = container.add_stream("libx264", rate=FPS, options={"crf": "18"})
            picture.width, picture.height, picture.pix_fmt = 2 * EYE_SIZE, EYE_SIZE, "yuv420p"
        if drop != "audio":
            sound = container.add_stream("pcm_s16le", rate=SAMPLE_RATE)
            sound.layout = "mono"
        count = 0
        source = ReplaySource(recording, ManualClock(), eyes=shown)
        for frame in frames_of(source):
            _export_frame(container, picture, sound, frame)
            count += 1
            progress(1 / FPS)
        for stream in filter(None, (picture, sound)):
            container.mux(stream.encode(None))
        container.close()
    return {
        "file": str(out),
        "frames": count,
        "seconds": count / FPS,
        "bytes": out.stat().st_size,
        "warnings": [source.missing] if source.missing else [],
    }


def _export_frame(container: Any, picture: Any, sound: Any, frame: SensorFrame) -> None:
    import av

    if picture is not None:
        both = np.zeros((EYE_SIZE, 2 * EYE_SIZE), np.uint8)
        if frame.eyes is not None:
            both = np.concatenate([frame.eyes[0], frame.eyes[1]], 1)
        image = av.VideoFrame.from_ndarray(both, format="gray")
        image.pts, image.time_base = frame.index, Fraction(1, FPS)
        container.mux(picture.encode(image))
    if sound is None:
        return
    values = np.clip(np.rint(frame.audio * 32768), -32768, 32767).astype(np.int16)
    chunk = av.AudioFrame.from_ndarray(values[None], format="s16", layout="mono")
    chunk.sample_rate, chunk.time_base = SAMPLE_RATE, Fraction(1, SAMPLE_RATE)
    chunk.pts = frame.index * SAMPLES_PER_FRAME
    container.mux(sound.encode(chunk))
