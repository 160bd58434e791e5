"""Sessions as a user meets them: `livedrive session create | info`; and all frames of one.

Flow: sound and eye videos -> create -> folder -> Recording -> replay_frames.
"""

import heapq
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sensors import files
from sensors.assemble import Assembler
from sensors.clock import ManualClock
from sensors.session.eye_video import count_pictures
from sensors.session.format import AUDIO_FILE, CARD_FILE, EYE_FILES, MOTION_FILE, TIMELINE_FILE
from sensors.session.media import eye_pictures, sound_blocks
from sensors.session.recording import Recording, RecordingWriter
from sensors.session.replay import ReplaySource
from sensors.session.streams import EyeStream
from sensors.session.timeline import EmotionEntry, RequestEntry
from sensors.types import (
    EYE_NAMES,
    NS,
    SAMPLE_RATE,
    SAMPLES_PER_FRAME,
    AudioPacket,
    EyePacket,
    InputError,
    SensorFrame,
)

EARLY_END_NS = NS // 2  # an eye video may end this much before the sound without a warning


def quiet(seconds: float) -> None:
    pass


def create(
    folder: str | Path,
    audio: str | Path,
    eyes: Sequence[str | Path] = (),  # left and right; one with both side by side; or none
    *,
    created: str = "",
    eye_codec: str = "ffv1",
    audio_format: str = "float32",
    heard: bool = True,  # False: its sound stands in for none, and is not judged
    progress: Callable[[float], object] = quiet,
) -> dict[str, Any]:
    """Make a session of files; return its `info` with `warnings`. Leaves nothing on bad input.

    `progress` is told of every part that is done, in seconds.
    """
    if len(eyes) > 2:
        raise InputError(
            f"eyes: expected two videos (left, right), one with both side by side, or none, got "
            f"{len(eyes)}"
        )
    folder, warnings = Path(folder), list[str]()
    if not folder.exists():
        files.check_folder(folder, "session create", "choose another")
    devices = {"audio": Path(audio).name}
    shown = list(eyes) * 2 if len(eyes) == 1 else eyes
    devices |= {f"eye_{EYE_NAMES[k]}": Path(eye).name for k, eye in enumerate(shown)}
    with whole(
        folder, created=created, devices=devices, eye_codec=eye_codec, audio_format=audio_format
    ) as writer:
        sound = _audio_packets(Path(audio), warnings if heard else [])
        _write_all(writer, sound, [Path(eye) for eye in eyes], warnings, progress)
    return info(folder) | {"warnings": warnings}


@contextmanager
def whole(folder: Path, **options: Any) -> Generator[RecordingWriter]:
    """A writer with these options; nothing is left of a session that fails or is stopped."""
    made = not folder.exists()
    writer = RecordingWriter(folder, **options)
    try:
        with files.all_or_nothing(), writer:
            yield writer
    except BaseException:
        for name in (CARD_FILE, AUDIO_FILE, *EYE_FILES, TIMELINE_FILE, MOTION_FILE):
            (folder / name).unlink(missing_ok=True)
        if made and not any(folder.iterdir()):
            folder.rmdir()
        raise


def info(folder: str | Path) -> dict[str, Any]:
    """What a session holds, as plain values. Repairs it first if its recording was killed."""
    with Recording(folder) as recording:
        samples, missing, gaps = 0, 0, 0
        expected: int | None = None
        for entry in recording.audio.entries:
            jump = 0 if expected is None else entry.first_sample - expected
            missing += max(jump, 0)
            gaps += bool(jump > 0 or entry.gap)
            samples += entry.num_samples
            expected = entry.first_sample + entry.num_samples
        held = [f for f in recording.folder.iterdir() if f.is_file()]
        start_ns = min((entry.t_ns for entry in recording.entries), default=0)
        return {
            "folder": str(recording.folder),
            "version": recording.card["version"],
            "created": recording.card.get("created", ""),
            "devices": dict(recording.info.devices),
            "seconds": round(recording.duration_ns / NS, 6),
            "frames": recording.num_frames,
            "partial_samples": recording.assembled_samples % SAMPLES_PER_FRAME,
            "audio_samples": samples,
            "audio_gaps": gaps,
            "audio_lost_samples": missing,
            "eyes": {EYE_NAMES[k]: _eye_info(s, start_ns) for k, s in recording.eyes.items()},
            "emotions": sum(isinstance(entry, EmotionEntry) for entry in recording.entries),
            "requests": sum(isinstance(entry, RequestEntry) for entry in recording.entries),
            "head_poses": len(recording.heads),
            "head_faces": sum(entry.face is not None for entry in recording.heads),
            "repaired": bool(recording.card.get("repaired", False)),
            "packets_lost_in_repair": int(recording.card.get("packets_lost_in_repair", 0)),
            "bytes": sum(f.stat().st_size for f in held),
        }


def replay_frames(
    recording: Recording, assembler: Assembler | None = None
) -> Iterator[SensorFrame]:
    """All frames of a recording, as fast as they are taken."""
    return frames_of(ReplaySource(recording, ManualClock()), assembler)


def frames_of(source: ReplaySource, assembler: Assembler | None = None) -> Iterator[SensorFrame]:
    assembler = assembler or Assembler()
    source.open()
    while not source.exhausted:
        for packet in source.poll():
            assembler.push(packet)
        yield from assembler.ready()
    source.close()


def _write_all(
    writer: RecordingWriter,
    sound: Iterator[AudioPacket],
    eyes: list[Path],
    warnings: list[str],
    progress: Callable[[float], object],
) -> None:
    """Append all packets in the order in which they would have arrived."""
    halves = EYE_NAMES if len(eyes) == 1 else (None, None)
    eyes = eyes * 2 if len(eyes) == 1 else eyes
    streams = [_eye_packets(eye, path, halves[eye]) for eye, path in enumerate(eyes)]
    pictures = heapq.merge(*streams, key=lambda packet: (packet.t_ns, packet.eye))
    picture = next(pictures, None)
    last_ns, end_ns = [0, 0], 0
    for packet in sound:
        end_ns = (packet.first_sample + len(packet.samples)) * NS // SAMPLE_RATE
        while picture is not None and picture.t_ns <= end_ns:
            writer.append(picture)
            last_ns[picture.eye] = picture.t_ns
            picture = next(pictures, None)
        progress(len(packet.samples) / SAMPLE_RATE)
        writer.append(packet)  # pictures after the last sound belong to no frame: left out
    for eye, path in enumerate(eyes):
        if last_ns[eye] < end_ns - EARLY_END_NS:
            warnings.append(
                f"{path}: ends at {last_ns[eye] / NS:.2f} s, the sound at {end_ns / NS:.2f} s; "
                "the last picture is held for a moment, then the eye counts as lost"
            )


def _audio_packets(path: Path, warnings: list[str]) -> Iterator[AudioPacket]:
    """One packet for each 1600 samples; the last one may be shorter."""
    first, rest = 0, np.zeros(0, np.float32)
    for block in sound_blocks(path, warnings):
        rest = np.concatenate([rest, block])
        while len(rest) >= SAMPLES_PER_FRAME:
            yield _audio_packet(first, rest[:SAMPLES_PER_FRAME])
            first, rest = first + SAMPLES_PER_FRAME, rest[SAMPLES_PER_FRAME:]
    if len(rest):
        yield _audio_packet(first, rest)


def _audio_packet(first: int, samples: NDArray[np.float32]) -> AudioPacket:
    return AudioPacket(first * NS // SAMPLE_RATE, first, samples)


def _eye_packets(eye: int, path: Path, half: Any) -> Iterator[EyePacket]:
    for counter, (t_ns, image) in enumerate(eye_pictures(path, half)):
        yield EyePacket(t_ns, eye, counter, image)


def _eye_info(stream: EyeStream, start_ns: int) -> dict[str, Any]:
    """Times from the session's start. `missing`: pictures that the timeline has and the video,
    which was cut, has not."""
    times = stream.t_ns
    held = count_pictures(stream.path)
    span_ns = int(times[-1] - times[0])
    return {
        "pictures": len(times),
        "missing": sum(entry.picture >= held for entry in stream.entries),
        "rate_hz": round((len(times) - 1) * NS / span_ns, 3) if span_ns > 0 else 0.0,
        "first_s": round((int(times[0]) - start_ns) / NS, 6),
        "last_s": round((int(times[-1]) - start_ns) / NS, 6),
        "codec": stream.codec,
    }
