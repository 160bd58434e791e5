"""Recording and RecordingWriter: a session folder (format version 1), read lazily, written safely.

Flow: Source.poll -> RecordingWriter (raw packets, before assembly) -> folder -> Recording ->
ReplaySource. `kill -9` while recording loses at most the last 100 ms; the next `Recording` repairs.
"""

from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from sensors import files
from sensors.assemble import MAX_FILL, check_audio, check_eye
from sensors.session import format as fmt
from sensors.session.eye_video import EYE_CODECS, EyeVideoWriter
from sensors.session.repair import lock, repair
from sensors.session.streams import AudioStream, EyeStream
from sensors.session.timeline import (
    AudioEntry,
    EmotionEntry,
    Entry,
    EyeEntry,
    HeadEntry,
    RequestEntry,
    check_counts,
    count,
    end_ns,
    entry_line,
    read_timeline,
)
from sensors.session.wav import FORMATS, WavWriter
from sensors.types import (
    FPS,
    SAMPLES_PER_FRAME,
    AudioPacket,
    EmotionPacket,
    HeadPacket,
    InputError,
    Packet,
    RequestPacket,
    SourceInfo,
)

PACED_REST_S = 0.75 / FPS  # between a picture that is due and the decoding of the next one


class Recording:
    """A session opened for reading: the timeline in memory, sound and pictures on demand."""

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        self.card = fmt.read_card(self.folder)
        if not self.card.get("closed"):
            self.card = repair(self.folder, self.card)
        self.entries = read_timeline(self.folder, closed=True)
        check_counts(self.folder, self.card, self.entries)
        self.heads = [e for e in self.entries if isinstance(e, HeadEntry)]
        sounds = [e for e in self.entries if isinstance(e, AudioEntry)]
        self.audio = AudioStream(self.folder / fmt.AUDIO_FILE, sounds)
        self.eyes: dict[int, EyeStream] = {}
        for eye, name in enumerate(fmt.EYE_FILES):
            pictures = [e for e in self.entries if isinstance(e, EyeEntry) and e.eye == eye]
            if pictures:
                self.eyes[eye] = EyeStream(self.folder / name, pictures)

    @property
    def duration_ns(self) -> int:
        """From the start of the first packet to the end of the last."""
        if not self.entries:
            return 0
        return max(map(end_ns, self.entries)) - min(e.t_ns for e in self.entries)

    @property
    def num_frames(self) -> int:
        """Frames that an assembler makes of the sound."""
        return self.assembled_samples // SAMPLES_PER_FRAME

    @property
    def assembled_samples(self) -> int:
        """Samples that an assembler makes frames of: the sound, and what it fills in for those that
        were lost."""
        samples, expected = 0, None
        for entry in self.audio.entries:
            missing = 0 if expected is None else max(entry.first_sample - expected, 0)
            samples += min(missing, MAX_FILL) + entry.num_samples
            expected = entry.first_sample + entry.num_samples
        return samples

    def check_frames(self) -> None:
        """Raises InputError unless there is a frame: no older file is emptied for nothing."""
        if not self.num_frames:
            samples = sum(entry.num_samples for entry in self.audio.entries)
            self.close()
            raise InputError(
                f"{self.folder}: expected at least one frame of sound ({SAMPLES_PER_FRAME} "
                f"samples), got {samples}; record a longer one, or make one with: "
                "livedrive session create DIR --audio x.wav"
            )

    @property
    def info(self) -> SourceInfo:
        devices = {str(k): str(v) for k, v in dict(self.card.get("devices", {})).items()}
        name, eyes = f"session {self.folder.name}", tuple(self.eyes)
        return SourceInfo(
            name=name,
            audio=bool(self.audio.entries),
            eyes=eyes,
            head=bool(self.heads),
            duration_ns=self.duration_ns,
            num_frames=self.num_frames,
            devices=devices,
        )

    def pace(self) -> None:
        """From now on its packets are asked for at the pace of the clock: pictures are decoded
        shortly before they are due, as cameras bring theirs, and not beside a tick's work."""
        for stream in self.eyes.values():
            stream.pace(PACED_REST_S)

    def packet(self, entry: Entry) -> Packet | None:
        """Read one packet; None if it is a picture that the video no longer holds."""
        if isinstance(entry, AudioEntry):
            return self.audio.packet(entry)
        if isinstance(entry, EmotionEntry):
            return EmotionPacket(entry.t_ns, entry.words)
        if isinstance(entry, RequestEntry):
            return RequestPacket(entry.t_ns, entry.wanted)
        if isinstance(entry, HeadEntry):
            return HeadPacket(entry.t_ns, entry.pose, entry.valid, entry.gaze, entry.face)
        return self.eyes[entry.eye].packet(entry)

    def close(self) -> None:
        """Release the files; reading again opens them again."""
        self.audio.close()
        for stream in self.eyes.values():
            stream.close()

    def __enter__(self) -> "Recording":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class RecordingWriter:
    """Writes packets as they arrive: the media, then the line that vouches for them.

    What `append` has returned for survives `kill -9`, less one picture an eye.
    """

    def __init__(
        self,
        folder: str | Path,
        *,
        created: str,  # date and time as text; the caller's clock, not ours
        devices: Mapping[str, str] | None = None,  # stream -> device name
        calibration: Mapping[str, Any] | None = None,
        eye_codec: str = "ffv1",
        audio_format: str = "float32",
    ) -> None:
        _check_choice("eye_codec", eye_codec, EYE_CODECS)
        _check_choice("audio_format", audio_format, tuple(FORMATS))
        self.folder = Path(folder)
        if self.folder.exists() and (not self.folder.is_dir() or any(self.folder.iterdir())):
            got = "one with files in it" if self.folder.is_dir() else "a file"
            raise InputError(
                f"{self.folder}: expected a new or empty folder, got {got}; choose another name"
            )
        self.folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        self._eye_codec = eye_codec
        self._card = fmt.new_card(
            created, devices or {}, calibration or {}, eye_codec, audio_format
        )
        timeline = files.create(self.folder / fmt.TIMELINE_FILE, private=True)
        self._timeline = timeline.open("ab", buffering=0)
        lock(self._timeline)
        sound = files.create(self.folder / fmt.AUDIO_FILE, private=True)
        self._wav = WavWriter(sound, audio_format)
        self._eyes: dict[int, EyeVideoWriter] = {}
        self._start_ns: int | None = None
        self._counts = {"audio": 0}  # of what the timeline vouches for
        self._closed = False
        fmt.write_card(self.folder, self._card, durable=False)  # a tick may wait for it

    def has_room(self, packet: Packet) -> bool:
        """False once its sound no longer fits into audio.wav: another session has to go on."""
        return not isinstance(packet, AudioPacket) or self._wav.has_room(len(packet.samples))

    def append(self, packet: Packet) -> None:
        if self._closed:
            raise RuntimeError(f"{self.folder}: append after close")
        if self._start_ns is None:
            self._start_ns = packet.t_ns
        if isinstance(packet, AudioPacket):
            check_audio(packet)
            offset = self._wav.append(packet.samples)
            first, num = packet.first_sample, len(packet.samples)
            entry: Entry = AudioEntry(packet.t_ns, first, num, offset, packet.gap)
        elif isinstance(packet, EmotionPacket):
            entry = EmotionEntry(packet.t_ns, packet.words)
        elif isinstance(packet, RequestPacket):
            entry = RequestEntry(packet.t_ns, packet.wanted)
        elif isinstance(packet, HeadPacket):
            entry = HeadEntry(packet.t_ns, packet.pose, packet.valid, packet.gaze, packet.face)
        else:
            check_eye(packet)
            if packet.eye not in self._eyes:
                path = files.create(self.folder / fmt.EYE_FILES[packet.eye], private=True)
                self._eyes[packet.eye] = EyeVideoWriter(path, self._eye_codec)
            picture = self._eyes[packet.eye].append(packet.image, packet.t_ns - self._start_ns)
            entry = EyeEntry(packet.t_ns, packet.eye, packet.counter, picture)
        files.write_all(self._timeline, entry_line(entry))
        count(self._counts, entry)

    def close(self, *, whole: bool = True) -> None:
        """Finish all files and mark the session closed, if it is whole: an append that failed has
        left parts of a packet. Calling it twice is harmless."""
        if self._closed:
            return
        self._closed = True
        with ExitStack() as opened:
            opened.callback(self._timeline.close)
            with ExitStack() as media:
                media.callback(self._wav.close)
                for video in self._eyes.values():
                    media.callback(video.close)
            if whole:
                self._card |= {"counts": self._counts, "closed": True}
                fmt.write_card(self.folder, self._card)

    def __enter__(self) -> "RecordingWriter":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _check_choice(name: str, value: str, choices: tuple[str, ...]) -> None:
    if value not in choices:
        raise InputError(f"{name}: expected one of {', '.join(choices)}, got {value!r}; choose one")
