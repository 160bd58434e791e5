"""Microphone: sound that is counted, dated and mixed to 48 kHz mono, and that comes back.

Flow: device -> InputStream (callback) -> BlockRing -> Microphone.poll -> AudioTimeline. Losses are
found by comparing the sample counter with the clock: a driver that stalls for a second may lose
half of it and raise no overflow flag.
"""

# pyright: reportMissingTypeStubs=false
import math
import threading
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sensors.audio.block_ring import SoundBlock
from sensors.audio.portaudio import DeviceError, InputStream, library
from sensors.clock_map import ClockMap
from sensors.types import NS, SAMPLE_RATE, AudioPacket, Clock, Packet, SourceInfo

STALL_NS = 3 * NS  # a stream that delivers nothing for so long is opened again
RETRY_S = (0.1, 0.25, 0.5)  # waits between attempts to open; the last one repeats
WATCH_S = 0.05
LEVEL_DECAY = 0.9  # of the meter, for each block of 10 ms
JOIN_S = 2.0


class Microphone:
    """A Source of sound from one device. A lost device is looked for until it is back."""

    def __init__(
        self,
        name: str | None,  # None: the system's default
        clock: Clock,
        *,
        rate: int | None = None,  # Hz to open the device with; None: 48 kHz where it can
        channels: int = 2,  # at most; they are averaged
    ) -> None:
        self.problem = ""  # why there is no sound now; empty while there is sound
        self.level = 0.0  # RMS of the last moments, 0..1
        self.delay_ns = 0  # from the end of the newest block to its callback, above the least
        self.losses = 0  # times that sound was lost while the device was there
        self.reopened = 0
        self._name, self._clock = name, clock
        self._rate, self._channels = rate, channels
        self._stream: InputStream | None = None
        self._thread: threading.Thread | None = None
        self._closing = threading.Event()
        self._track = Track()
        self._dropped = 0

    @property
    def info(self) -> SourceInfo:
        name = self._name or "default"
        return SourceInfo(f"microphone {name}", devices={"audio": name})

    @property
    def exhausted(self) -> bool:
        return False

    @property
    def dropped(self) -> int:
        """Samples at 48 kHz known to be lost."""
        return self._dropped

    @property
    def drift_ppm(self) -> float:
        return self._track.map.drift_ppm

    @property
    def level_db(self) -> float:
        return 20 * math.log10(max(self.level, 1e-6))

    def open(self) -> None:
        """Start looking for the device; returns at once, sound comes when it is there."""
        library()
        self._closing.clear()
        self._track, self._dropped = Track(), 0
        self.problem = "opening"
        self._thread = threading.Thread(target=self._supervise, name="microphone", daemon=True)
        self._thread.start()

    def poll(self) -> list[Packet]:
        if self._thread is None:
            raise RuntimeError("poll before open")
        stream = self._stream
        if stream is None:
            return []
        track = self._track
        if track.stream is not stream:
            track.restart(stream)
        packets: list[Packet] = []
        for block in stream.ring.read():
            packet = track.packet(block)
            self.losses += track.lost > 0
            self._dropped += track.lost
            self.delay_ns = track.map.delay_ns
            if packet is not None:
                packets.append(packet)
                self.level = followed(self.level, packet.samples)
        return packets

    def close(self) -> None:
        """Release the device. A sound server that hangs is left behind after two seconds."""
        if self._thread is not None:
            self._closing.set()
            self._thread.join(JOIN_S)
            if self._thread.is_alive():
                _forget_portaudio()
        self._thread = self._stream = None

    def _supervise(self) -> None:
        """Open the device, watch it, open it again: the only thread that talks to PortAudio."""
        failures = 0
        while not self._closing.wait(WATCH_S):
            stream = self._stream
            try:
                if stream is None:
                    stream = InputStream(self._name, self._clock, self._rate, self._channels)
                    self._stream = stream
                    self.problem, failures = "", 0
                silent_ns = self._clock.now_ns() - stream.last_arrival_ns
                if stream.finished.is_set() or silent_ns > STALL_NS:
                    self.problem = "no sound arrives"
                    self._stream = None
                    self.reopened += 1
                    stream.close()
            except DeviceError as error:
                self.problem = str(error)
                self._closing.wait(RETRY_S[min(failures, len(RETRY_S) - 1)])
                failures += 1
        if self._stream is not None:
            self._stream.close()


@dataclass
class Track:
    """Counts and dates the blocks of one stream after the other, as one run of 48 kHz mono."""

    stream: InputStream | None = None
    map: ClockMap = field(default_factory=ClockMap)
    position: int = 0  # 48 kHz samples given so far, lost ones included
    lost: int = 0  # 48 kHz samples found lost with the last block
    end_ns: int | None = None  # time after the last sample given
    _resampler: "_Resampler | None" = None
    _counter: int = 0  # the stream's own counter, expected next

    def restart(self, stream: InputStream) -> None:
        """Go on with a new stream; its first block says how much time has passed."""
        self.stream, self.map, self._counter = stream, ClockMap(), -1
        self._resampler = None if stream.rate == SAMPLE_RATE else _Resampler(stream.rate)

    def packet(self, block: SoundBlock) -> AudioPacket | None:
        assert self.stream is not None
        rate = self.stream.rate
        end = block.first_sample + len(block.samples)
        end_ns = min(self.map.update(end * NS // rate, block.arrival_ns), block.arrival_ns)
        t_ns = end_ns - len(block.samples) * NS // rate
        skipped = block.first_sample - self._counter
        if self._counter < 0:  # the first block of this stream
            lost_ns = 0 if self.end_ns is None else max(t_ns - self.end_ns, 0)
            skipped = lost_ns * rate // NS
        elif self.map.jump_ns > 0:
            skipped += self.map.jump_ns * rate // NS
        self._counter = end
        self.lost = skipped * SAMPLE_RATE // rate
        self.position += self.lost
        mono = block.samples.mean(1, dtype=np.float32)
        if self._resampler is not None:
            mono = self._resampler(mono)
            t_ns -= self._resampler.delay_ns
        if not len(mono):
            return None
        packet = AudioPacket(t_ns, self.position, mono, gap=self.lost > 0 or block.overflow)
        self.position += len(mono)
        self.end_ns = end_ns
        return packet


class _Resampler:
    """Streaming, causal, to 48 kHz. soxr LQ hands a sample out half a millisecond late."""

    def __init__(self, rate: int) -> None:
        import soxr

        self._stream = soxr.ResampleStream(rate, SAMPLE_RATE, 1, dtype="float32", quality="LQ")
        self._rate, self._taken, self._given = rate, 0, 0
        self.delay_ns = 0  # of the first sample of the last result

    def __call__(
        self,
        samples: NDArray[np.float32],  # [n]
    ) -> NDArray[np.float32]:
        first_ns = self._given * NS // SAMPLE_RATE
        self.delay_ns = self._taken * NS // self._rate - first_ns
        out: NDArray[np.float32] = self._stream.resample_chunk(samples)
        self._taken += len(samples)
        self._given += len(out)
        return out


def _forget_portaudio() -> None:
    """Keep sounddevice from waiting at exit for a stream that never closes."""
    import atexit

    sounddevice = library()
    atexit.unregister(sounddevice._exit_handler)


def followed(level: float, samples: NDArray[np.float32]) -> float:  # [n]
    """The level after these samples; a driver may give some that are no numbers."""
    mean = float(np.mean(np.square(np.nan_to_num(samples, posinf=0, neginf=0))))
    return math.sqrt(LEVEL_DECAY * level**2 + (1 - LEVEL_DECAY) * mean)
