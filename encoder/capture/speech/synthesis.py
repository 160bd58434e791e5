"""Rule-made speech: text spoken by flite, festival or espeak-ng, with the time of every phone.

First stage of the capture: text -> (audio 48 kHz, phones). All engines are parametric voices or
free diphones. Formants move by resampling; pitch and length are asked of the engine the other way.
"""

import ctypes
import os
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import soundfile
import soxr

from encoder import stopping
from encoder.capture.speech.phones import (
    PHONE_INDEX,
    Phone,
    Speech,
    from_festival,
    from_ipa,
)
from sensors.types import SAMPLE_RATE, InputError

FLITE_VOICES = ("slt", "rms", "awb", "kal16")
FESTIVAL_VOICES = {"slt_hts": "voice_cmu_us_slt_arctic_hts", "kal": "voice_kal_diphone"}
_MEAN_HZ = {"slt": 170, "rms": 95, "awb": 120, "kal16": 105}
_ESPEAK_LATE_S = 0.006  # espeak-ng's events come this much after the sound
_ESPEAK_CLOSURE_S = 0.029  # what it bills of a plosive's closure to the phone before


def _check(engine: str, text: str) -> None:
    if not text.strip():
        raise InputError(f"text to speak with {engine}: expected words, got nothing; give a text")


def _resampled(audio: np.ndarray, rate: int, formants: float, phones: list[Phone]) -> Speech:
    """Play `formants` times as fast: pitch, formants and tempo all rise by it."""
    moved = soxr.resample(audio.astype(np.float32), rate * formants, SAMPLE_RATE)
    scaled = [Phone(p.name, p.start / formants, p.end / formants) for p in phones]
    return Speech(moved.astype(np.float32), scaled)


def _run(command: list[str], package: str) -> str:
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=True)
    except FileNotFoundError:
        raise InputError(
            f"{command[0]}: expected on the PATH, not found; apt install {package}"
        ) from None
    return done.stdout


def speak_flite(
    text: str, voice: str, pitch: float = 1.0, stretch: float = 1.0, formants: float = 1.0
) -> Speech:
    """Speak with flite. `pitch` scales the mean pitch, `stretch` the durations."""
    _check("flite", text)
    if voice not in _MEAN_HZ:
        choices = ", ".join(FLITE_VOICES)
        raise InputError(f"flite voice: expected one of {choices}, got {voice!r}; choose one")
    mean_hz = _MEAN_HZ[voice] * pitch / formants
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "speech.wav"
        command = ["flite", "-voice", voice, "-psdur", "-t", text, "-o", str(path)]
        for setting in (
            f"int_f0_target_mean={mean_hz:.0f}",
            f"duration_stretch={stretch * formants:.2f}",
        ):
            command += ["--setf", setting]
        printed = _run(command, "flite")
        audio, rate = soundfile.read(path, dtype="float32")
    phones, start = [], 0.0
    for token in printed.split():
        name, _, end = token.rpartition(":")
        if name in PHONE_INDEX:
            phones.append(Phone(name, start, float(end)))
        start = float(end)
    return _resampled(audio, rate, formants, phones)


def speak_festival(
    texts: Sequence[str], voice: str, stretch: float = 1.0, formants: float = 1.0
) -> list[Speech]:
    """Speak several texts in one run of festival, which starts slowly."""
    for text in texts:
        _check("festival", text)
    if voice not in FESTIVAL_VOICES:
        choices = ", ".join(FESTIVAL_VOICES)
        raise InputError(f"festival voice: expected one of {choices}, got {voice!r}; choose one")
    lines = [f"({FESTIVAL_VOICES[voice]})", f"(Param.set 'Duration_Stretch {stretch * formants})"]
    spoken = []
    with tempfile.TemporaryDirectory() as folder:
        for k, text in enumerate(texts):
            plain = text.replace("\\", "").replace('"', "")
            lines.append(f'(set! u (utt.synth (Utterance Text "{plain}")))')
            lines.append(f'(utt.save.wave u "{folder}/{k}.wav")')
            lines.append(f'(utt.save.segs u "{folder}/{k}.seg")')
        script = Path(folder) / "speak.scm"
        script.write_text("\n".join(lines))
        _run(["festival", "--batch", str(script)], "festival festvox-us-slt-hts festvox-kallpc16k")
        for k in range(len(texts)):
            audio, rate = soundfile.read(Path(folder) / f"{k}.wav", dtype="float32")
            phones, start = [], 0.0
            for line in (Path(folder) / f"{k}.seg").read_text().splitlines():
                parts = line.split()
                if len(parts) == 3 and parts[0].replace(".", "").isdigit():
                    phones.append(Phone(from_festival(parts[2]), start, float(parts[0])))
                    start = float(parts[0])
            spoken.append(_resampled(audio, rate, formants, phones))
    return spoken


class _EventId(ctypes.Union):
    _fields_ = [("number", ctypes.c_int), ("name", ctypes.c_char_p), ("string", ctypes.c_char * 8)]


class _Event(ctypes.Structure):
    _fields_ = [
        ("type", ctypes.c_int),
        ("unique_identifier", ctypes.c_uint),
        ("text_position", ctypes.c_int),
        ("length", ctypes.c_int),
        ("audio_position", ctypes.c_int),
        ("sample", ctypes.c_int),
        ("user_data", ctypes.c_void_p),
        ("id", _EventId),
    ]


_PHONEME_EVENT = 7
_CALLBACK = ctypes.CFUNCTYPE(
    ctypes.c_int, ctypes.POINTER(ctypes.c_short), ctypes.c_int, ctypes.POINTER(_Event)
)


class Espeak:
    """The espeak-ng library, which alone tells phone times; one per process."""

    def __init__(self) -> None:
        try:
            self._library = ctypes.CDLL("libespeak-ng.so.1")
        except OSError:
            raise InputError(
                "espeak-ng: expected libespeak-ng.so.1, not found; apt install espeak-ng"
            ) from None
        # 2: synchronous, samples to the callback; options 1 | 2: phoneme events, in IPA
        self._rate = self._library.espeak_Initialize(2, 0, None, 1 | 2)
        self._chunks: list[np.ndarray] = []
        self._events: list[tuple[int, str]] = []
        self._callback = _CALLBACK(self._collect)  # kept: the library holds only the pointer
        self._library.espeak_SetSynthCallback(self._callback)

    def _collect(self, wave, count, events) -> int:  # noqa: ANN001 (ctypes pointers)
        if wave and count > 0:
            self._chunks.append(np.ctypeslib.as_array(wave, (count,)).copy())
        index = 0
        while events[index].type != 0:
            if events[index].type == _PHONEME_EVENT:
                name = bytes(events[index].id.string).decode("utf8", "ignore")
                self._events.append((events[index].sample, name))
            index += 1
        return 0

    def speak(
        self,
        text: str,
        voice: str,
        words_per_minute: int = 165,
        pitch: int = 50,
        tone: int = 50,
        formants: float = 1.0,
    ) -> Speech:
        """Speak with `voice` such as "en-us+f3"; `pitch` and its range `tone` are 0..100."""
        _check("espeak-ng", text)
        if self._library.espeak_SetVoiceByName(voice.encode()) != 0:
            raise InputError(
                f"espeak-ng voice: expected a known one, got {voice!r}; "
                "list them with espeak-ng --voices=variant"
            )
        slower = round(words_per_minute / formants)
        for parameter, value in ((1, slower), (3, pitch), (4, tone)):
            self._library.espeak_SetParameter(parameter, int(value), 0)
        self._chunks, self._events = [], []
        data = text.encode()
        # Voices with breath read the C library's rand(), so that sound would depend on history.
        _LIBC.srand(1)
        with stopping.postponed():  # the library swallows what is raised in `_collect`
            self._library.espeak_Synth(data, len(data) + 1, 0, 1, 0, 1, None, None)
        audio = np.concatenate(self._chunks).astype(np.float32) / 32768
        phones = _espeak_phones(self._events, len(audio), self._rate)
        return _resampled(audio, self._rate, formants, phones)


_LIBC = ctypes.CDLL(None) if os.name == "posix" else ctypes.cdll.msvcrt


def _espeak_phones(events: list[tuple[int, str]], samples: int, rate: int) -> list[Phone]:
    """Events (first sample, IPA) -> phones; empty events are dropped, starts are corrected."""
    bounds = [sample for sample, _ in events[1:]] + [samples]
    kept = [
        (from_ipa(ipa), a / rate - _ESPEAK_LATE_S, b / rate - _ESPEAK_LATE_S)
        for (a, ipa), b in zip(events, bounds, strict=True)
        if b > a
    ]
    kept = [row for row in kept if row[0]]  # marks lengthen the phone before
    starts = [start for _, start, _ in kept]
    for k in range(1, len(kept)):
        if kept[k][0] in ("p", "b", "t", "d", "k", "g"):
            room = 0.4 * (kept[k][1] - kept[k - 1][1])
            starts[k] -= min(_ESPEAK_CLOSURE_S, max(room, 0.0))
    ends = [*starts[1:], kept[-1][2]] if kept else []
    return [
        Phone(name, max(0.0, start), max(0.0, end))
        for (name, _, _), start, end in zip(kept, starts, ends, strict=True)
        if end > start
    ]
