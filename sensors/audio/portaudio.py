"""PortAudio through sounddevice: which microphones exist, and one open input stream.

Flow: device -> callback -> BlockRing -> Microphone. PulseAudio and PipeWire are one PortAudio
device, `pulse`; their sources are chosen as `pulse:NAME`.
"""

# pyright: reportMissingTypeStubs=false
import json
import os
import shutil
import subprocess
import sys
import threading
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from sensors.audio.block_ring import BlockRing
from sensors.types import SAMPLE_RATE, Clock, InputError

BLOCK_SIZE = 480  # 10 ms; blocks of a whole frame come in pairs, 67 ms apart
LATENCY_S = 0.03  # at 0.04 PulseAudio delivers two blocks at a time, 8 ms later
RING_BLOCKS = 256  # 2.5 s
PULSE = "pulse:"
# PortAudio is one a process and not made for two threads: starting it over while another thread
# still waits for a hanging server to close its stream crashed Python.
_PORTAUDIO = threading.Lock()


@dataclass(frozen=True)
class MicrophoneInfo:
    """One line of `livedrive devices`."""

    name: str  # what --mic takes
    channels: int
    rate: int  # Hz, the device's own
    default: bool


class DeviceError(Exception):
    """The microphone cannot be opened now; it may come back."""


def library() -> Any:
    """The sounddevice module; importing it loads PortAudio."""
    try:
        import sounddevice
    except OSError as error:
        raise InputError(
            f"microphone: expected the PortAudio library, got {error}; "
            "run: sudo apt-get install libportaudio2"
        ) from None
    return sounddevice


def microphones() -> list[MicrophoneInfo]:
    """All inputs that can be opened by name."""
    sounddevice = library()
    with _PORTAUDIO:
        default, listed = sounddevice.default.device[0], sounddevice.query_devices()
    found = [
        MicrophoneInfo(
            name=str(device["name"]),
            channels=int(device["max_input_channels"]),
            rate=int(device["default_samplerate"]),
            default=device["index"] == default,
        )
        for device in listed
        if device["max_input_channels"] > 0
    ]
    return [*found, *_pulse_sources()]


def find_name(name: str) -> str:
    """The name of the one microphone that `name` is, or is a part of; InputError otherwise."""
    names = [m.name for m in microphones()]
    if not names:
        raise InputError(
            f"--mic {name}: expected a microphone, got none here; plug one in, see: livedrive "
            "devices, or go on with --mic none"
        )
    matches = [n for n in names if name.lower() in n.lower()]
    if name not in names and len(matches) != 1:
        got = "several: " + ", ".join(matches) if matches else f"no {name!r}"
        raise InputError(
            f"--mic: expected one of {', '.join(names)}, got {got}; see: livedrive devices"
        )
    return name if name in names else matches[0]


class InputStream:
    """An open microphone that fills a ring until it is closed or fails."""

    def __init__(self, name: str | None, clock: Clock, rate: int | None, channels: int) -> None:
        """Open and start. With `rate` None: 48 kHz if the device has it, else its own rate."""
        self.finished = threading.Event()
        self.last_arrival_ns = clock.now_ns()
        device = name
        if name and name.startswith(PULSE):
            os.environ["PULSE_SOURCE"] = name.removeprefix(PULSE)
            device = "pulse"
        with _PORTAUDIO:
            self._open(device, clock, rate, channels)

    def _open(self, device: str | None, clock: Clock, rate: int | None, channels: int) -> None:
        sounddevice = library()
        try:
            # PortAudio lists devices once; only starting over sees what was plugged in since.
            if sounddevice._initialized:  # else to start it over has failed before
                sounddevice._terminate()
            sounddevice._initialize()
            if device is None and sounddevice.default.device[0] < 0:
                raise DeviceError("no microphone is plugged in")
            found: Mapping[str, Any] = sounddevice.query_devices(device, "input")
            self.channels = min(channels, int(found["max_input_channels"]))
            rates = (rate,) if rate else (SAMPLE_RATE, int(found["default_samplerate"]))
            self.rate = next((r for r in rates if self._takes(found["index"], r)), rates[-1])
            self.ring = BlockRing(RING_BLOCKS, BLOCK_SIZE, self.channels)
            self._stream = sounddevice.InputStream(
                device=found["index"],
                channels=self.channels,
                samplerate=self.rate,
                blocksize=BLOCK_SIZE,
                latency=LATENCY_S,
                dtype="float32",
                callback=self._callback,
                finished_callback=self.finished.set,
            )
            self._clock = clock
            self._stream.start()
        except (sounddevice.PortAudioError, ValueError) as error:
            raise DeviceError(" ".join(str(error).split())) from None

    def close(self) -> None:
        """Stop. Blocks for as long as the sound server hangs."""
        with _PORTAUDIO:
            self._stream.abort()
            self._stream.close()

    def _takes(self, device: int, rate: int) -> bool:
        sounddevice = library()
        try:
            sounddevice.check_input_settings(device, channels=self.channels, samplerate=rate)
        except (sounddevice.PortAudioError, ValueError):
            return False
        return True

    def _callback(self, samples: Any, num: int, times: Any, status: Any) -> None:
        now_ns = self._clock.now_ns()
        self.ring.write(samples, now_ns, bool(status.input_overflow))
        self.last_arrival_ns = now_ns


def silence_native_messages() -> None:
    """Send what C libraries print to nowhere; ALSA and PortAudio write to the terminal."""
    sys.stderr.flush()
    sys.stderr = os.fdopen(os.dup(2), "w", buffering=1, encoding="utf-8")
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 2)
    os.close(null)


def _pulse_sources() -> list[MicrophoneInfo]:
    """Sources of PulseAudio or PipeWire, where its `pactl` is installed."""
    if shutil.which("pactl") is None:
        return []
    try:
        done = subprocess.run(
            ["pactl", "--format=json", "list", "sources"],
            capture_output=True,
            timeout=2,
            check=True,
        )
        sources = json.loads(done.stdout)
        found: list[MicrophoneInfo] = []
        for source in sources:
            _, channels, rate = source["sample_specification"].split()  # s16le 1ch 48000Hz
            name, default = PULSE + source["name"], False
            found.append(MicrophoneInfo(name, int(channels[:-2]), int(rate[:-2]), default))
    except (OSError, subprocess.SubprocessError, ValueError, KeyError, TypeError, AttributeError):
        return []
    return found
