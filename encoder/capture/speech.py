"""Rule-made speech: English sentences, spoken by flite or espeak-ng, with the time of every phone.

First stage of the capture: text -> (audio 48 kHz, phones). Both engines are parametric voices.
"""

import ctypes
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import soundfile
import soxr

from sensors.types import SAMPLE_RATE, InputError

FLITE_VOICES = ("slt", "rms", "awb", "kal16")
# ARPABET as flite prints it; index 0 is silence.
_PHONE_NAMES = (
    "pau aa ae ah ao aw ax ay b ch d dh eh er ey f g hh ih iy jh k l m n ng ow oy p r s sh t th "
    "uh uw v w y z zh"
)
PHONES: tuple[str, ...] = tuple(_PHONE_NAMES.split())
PHONE_INDEX = {phone: index for index, phone in enumerate(PHONES)}
_IPA = (
    "tʃ:ch dʒ:jh aɪ:ay aʊ:aw oʊ:ow əʊ:ow ɔɪ:oy eɪ:ey ɑː:aa ɔː:ao iː:iy uː:uw ɜː:er əl:l "
    "ɪə:ih eə:eh ʊə:uh ɑ:aa æ:ae ʌ:ah ɐ:ax ə:ax ɔ:ao ɒ:aa ɛ:eh e:eh ɚ:er ɝ:er ɪ:ih i:iy ᵻ:ih "
    "ʊ:uh u:uw o:ow a:aa b:b d:d ð:dh f:f ɡ:g g:g h:hh j:y k:k l:l ɫ:l m:m n:n ŋ:ng p:p ɹ:r "
    "r:r ɾ:d ʔ:t s:s ʃ:sh t:t θ:th v:v w:w z:z ʒ:zh x:hh"
)
_IPA_TO_PHONE = {pair.split(":")[0]: pair.split(":")[1] for pair in _IPA.split()}


@dataclass(frozen=True)
class Phone:
    """One phone of a spoken clip; times in seconds from the first sample."""

    name: str
    start: float
    end: float


@dataclass(frozen=True)
class Speech:
    """audio [n] float32 -1..1 at 48 kHz, and the phones that cover it in order."""

    audio: np.ndarray
    phones: list[Phone]


def _check(engine: str, text: str) -> None:
    if not text.strip():
        raise InputError(f"text to speak with {engine}: expected words, got nothing; pass --text")


def speak_flite(text: str, voice: str, pitch: float = 1.0, stretch: float = 1.0) -> Speech:
    """Speak with flite. `pitch` scales the mean pitch, `stretch` the durations."""
    _check("flite", text)
    mean_hz = {"slt": 170, "rms": 95, "awb": 120, "kal16": 105}.get(voice)
    if mean_hz is None:
        choices = ", ".join(FLITE_VOICES)
        raise InputError(f"flite voice: expected one of {choices}, got {voice!r}; choose one")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "speech.wav"
        settings = [f"int_f0_target_mean={mean_hz * pitch:.0f}", f"duration_stretch={stretch:.2f}"]
        command = ["flite", "-voice", voice, "-psdur", "-t", text, "-o", str(path)]
        for setting in settings:
            command += ["--setf", setting]
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
        except FileNotFoundError:
            raise InputError("flite: expected on the PATH, not found; apt install flite") from None
        audio, rate = soundfile.read(path, dtype="float32")
    phones, start = [], 0.0
    for token in done.stdout.split():
        name, _, end = token.rpartition(":")
        if name in PHONE_INDEX:
            phones.append(Phone(name, start, float(end)))
        start = float(end)
    return Speech(soxr.resample(audio, rate, SAMPLE_RATE).astype(np.float32), phones)


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
        self, text: str, voice: str, words_per_minute: int = 165, pitch: int = 50, tone: int = 50
    ) -> Speech:
        """Speak with `voice` such as "en-us+f3"; `pitch` and its range `tone` are 0..100."""
        _check("espeak-ng", text)
        if self._library.espeak_SetVoiceByName(voice.encode()) != 0:
            raise InputError(
                f"espeak-ng voice: expected a known one, got {voice!r}; "
                "list them with espeak-ng --voices=variant"
            )
        for parameter, value in ((1, words_per_minute), (3, pitch), (4, tone)):
            self._library.espeak_SetParameter(parameter, value, 0)
        self._chunks, self._events = [], []
        data = text.encode()
        self._library.espeak_Synth(data, len(data) + 1, 0, 1, 0, 1, None, None)
        audio = np.concatenate(self._chunks).astype(np.float32) / 32768
        phones = _espeak_phones(self._events, len(audio), self._rate)
        return Speech(soxr.resample(audio, self._rate, SAMPLE_RATE).astype(np.float32), phones)


def _espeak_phones(events: list[tuple[int, str]], samples: int, rate: int) -> list[Phone]:
    """Events (first sample, IPA) -> phones; empty events are dropped, times come 6 ms late."""
    bounds = [sample for sample, _ in events[1:]] + [samples]
    phones = []
    for (start, ipa), end in zip(events, bounds, strict=True):
        if end <= start:
            continue
        plain = ipa.strip("ˈˌ")
        name = _IPA_TO_PHONE.get(plain) or _IPA_TO_PHONE.get(plain[:1]) or "pau"
        phones.append(Phone(name, max(0.0, start / rate - 0.006), max(0.0, end / rate - 0.006)))
    return phones
