"""LiveSource: microphone, eye cameras and head tracker as one Source, by the rules of frames.

Flow: Microphone, EyeCameras -> LiveSource.poll -> Assembler -> SensorFrame, and -> LiveRecorder.
The sample count is the master clock; without a microphone the monotonic clock feeds silence that is
marked as a gap. Nothing here waits: a lost sensor costs its own data and no frame.
"""

from collections.abc import Sequence
from typing import Protocol

from sensors.audio.timeline import LAG_NS, AudioTimeline
from sensors.cameras.camera import EyeCamera
from sensors.head.source import HeadSource
from sensors.types import SAMPLE_RATE, AudioPacket, Clock, Packet, Source, SourceInfo


class LiveMicrophone(Source, Protocol):
    """A Source of sound that comes and goes: a device here, or one on the network."""

    problem: str  # why there is no sound now; empty while there is
    losses: int  # times that sound was lost
    reopened: int

    @property
    def drift_ppm(self) -> float: ...


class LiveSource:
    """Sound first to last without a break, and the newest picture of each eye."""

    def __init__(
        self,
        microphone: LiveMicrophone | None,
        cameras: Sequence[EyeCamera],
        clock: Clock,
        *,
        head: HeadSource | None = None,
        seconds: float | None = None,  # end by itself after so much sound
    ) -> None:
        self.microphone, self.cameras = microphone, tuple(cameras)
        self.head = head
        self._clock = clock
        self._max_samples = None if seconds is None else int(seconds * SAMPLE_RATE)
        self._timeline: AudioTimeline | None = None
        self._is_open = self._stopped = False

    @property
    def info(self) -> SourceInfo:
        devices = dict(self.microphone.info.devices) if self.microphone else {}
        for camera in self.cameras:
            devices |= camera.devices
        eyes = tuple(sorted(eye for camera in self.cameras for eye in camera.views.eyes))
        if self.head:
            devices |= self.head.info.devices
        head = self.head is not None
        return SourceInfo("live", audio=True, eyes=eyes, head=head, devices=devices)

    @property
    def exhausted(self) -> bool:
        if self._stopped:
            return True
        if self._timeline is None or self._max_samples is None:
            return False
        return self._timeline.position >= self._max_samples

    @property
    def dropped(self) -> int:
        """Samples that the microphone lost; pictures and poses that no frame could use."""
        lost = self.microphone.dropped if self.microphone else 0
        lost += self.head.dropped if self.head else 0
        return lost + sum(camera.dropped for camera in self.cameras)

    @property
    def silence_samples(self) -> int:
        """Samples that the clock fed in place of sound."""
        return self._timeline.silence if self._timeline else 0

    def open(self) -> None:
        if self.microphone:
            self.microphone.open()
        for camera in self.cameras:
            camera.open()
        if self.head:
            self.head.open()
        self._timeline = AudioTimeline(self._clock.now_ns(), LAG_NS if self.microphone else 0)
        self._is_open = True  # and a stop that came while everything was loaded stands

    def stop(self) -> None:
        """No packet comes any more; for signal handlers."""
        self._stopped = True

    def poll(self) -> list[Packet]:
        if self._timeline is None or not self._is_open:
            raise RuntimeError("poll before open")
        if self.exhausted:
            return []
        packets: list[Packet] = []
        for camera in self.cameras:
            packets += camera.poll()
        if self.head:
            packets += self.head.poll()
        for packet in self.microphone.poll() if self.microphone else ():
            assert isinstance(packet, AudioPacket)
            packets += self._timeline.push(packet)
        packets += self._timeline.fill(self._clock.now_ns())
        return packets

    def close(self) -> None:
        self._is_open = False
        for camera in self.cameras:
            camera.close()
        if self.head:
            self.head.close()
        if self.microphone:
            self.microphone.close()
