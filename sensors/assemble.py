"""Assembler: packets in, 30 FPS SensorFrames out.

Flow: Source.poll -> Assembler -> SensorFrame -> Driver.step (paper section 3, "system overview").
The audio sample count is the master clock: a frame exists when its 1600 samples exist. Frames are
formed while packets are pushed, so they depend on the order of the packets alone, never on when
`ready` is called; that is why a replay of the recorded order equals the live run bit for bit.
"""

from collections import deque

import numpy as np
from numpy.typing import NDArray

from sensors.types import (
    EYE_SIZE,
    NS,
    SAMPLE_RATE,
    SAMPLES_PER_FRAME,
    AudioPacket,
    EmotionPacket,
    EyePacket,
    HeadPacket,
    HeadPose,
    InputError,
    Packet,
    Request,
    RequestPacket,
    SensorFrame,
)

EYE_TOLERANCE_NS = 100_000_000  # an older picture is held but no longer valid
HEAD_TOLERANCE_NS = 150_000_000  # an older pose is held but no longer valid
MAX_FILL = 10 * SAMPLE_RATE  # longer losses (a suspended machine) become 10 s of silence
MAX_TIME_ERROR_NS = 2_000_000  # packet times may differ this much from the sample count
MAX_WAITING_PICTURES = 128  # per eye, when no sound completes a frame; the oldest go first
MAX_WAITING_POSES = 512
MAX_REQUESTS = 8  # for one frame; nobody asks so often
LOUDEST = 1000.0  # 60 dB over full scale: what is louder is no sound


class Assembler:
    """Cuts sound into frames and gives each the newest eye pictures that existed at its end.

    Lost sound (a jump of the device counter) becomes silence with `audio_gap` set, so that frame
    numbers keep step with real time. Frame times come from the sample count, anchored to a packet
    time; the anchor moves only when sample count and packet time have come 2 ms apart. What is no
    sound, as NaN, counts as lost: the networks would hear it for ever.
    """

    def __init__(self, *, eye_tolerance_ns: int = EYE_TOLERANCE_NS) -> None:
        self.lost_samples = 0  # samples that the device counter skipped
        self.lost_pictures = 0  # pictures that the camera counters skipped
        self._eye_tolerance_ns = eye_tolerance_ns
        self._frames: list[SensorFrame] = []
        self._index = 0
        self._last_t_ns: int | None = None
        self._audio = np.zeros(SAMPLES_PER_FRAME, np.float32)  # the frame in the making
        self._fill = 0
        self._gap = False
        self._position = 0  # samples assembled so far, silence included
        self._next_sample: int | None = None  # device counter expected next
        self._anchor_t_ns = 0  # time of sample `_anchor_position`
        self._anchor_position = 0
        self._waiting: tuple[deque[EyePacket], ...] = tuple(
            deque[EyePacket](maxlen=MAX_WAITING_PICTURES) for _ in range(2)
        )
        self._shown: list[EyePacket | None] = [None, None]
        self._next_counter: list[int | None] = [None, None]
        self._emotions = deque[EmotionPacket](maxlen=MAX_WAITING_PICTURES)
        self._emotion = ""
        self._requests: tuple[Request, ...] = ()  # since the last frame
        self._poses = deque[HeadPacket](maxlen=MAX_WAITING_POSES)
        self._pose: HeadPacket | None = None

    @property
    def partial_samples(self) -> int:
        """Samples of the unfinished frame; at the end of a stream these are dropped."""
        return self._fill

    def push(self, packet: Packet) -> None:
        if isinstance(packet, AudioPacket):
            self._push_audio(packet)
        elif isinstance(packet, EmotionPacket):
            self._emotions.append(packet)
        elif isinstance(packet, RequestPacket):
            self._requests = (*self._requests, packet.wanted)[-MAX_REQUESTS:]
        elif isinstance(packet, HeadPacket):
            self._poses.append(packet)
        else:
            self._push_eye(packet)

    def ready(self) -> list[SensorFrame]:
        """Return the frames completed since the last call, oldest first."""
        frames, self._frames = self._frames, []
        return frames

    def _push_audio(self, packet: AudioPacket) -> None:
        check_audio(packet)
        if self._next_sample is None:
            self._next_sample = packet.first_sample
            self._anchor_t_ns = packet.t_ns
        missing = packet.first_sample - self._next_sample
        if missing < 0:
            raise InputError(
                f"audio packet goes back: expected first_sample >= {self._next_sample}, "
                f"got {packet.first_sample}; a source must keep counting when it restarts"
            )
        if missing:
            self.lost_samples += missing
            self._append(np.zeros(min(missing, MAX_FILL), np.float32), gap=True)
        if abs(packet.t_ns - self._time_at(self._position)) > MAX_TIME_ERROR_NS:
            self._anchor_t_ns, self._anchor_position = packet.t_ns, self._position
        is_sound = np.abs(packet.samples) <= LOUDEST  # False for NaN
        if is_sound.all():
            self._append(packet.samples, gap=packet.gap)
        else:
            self._append(np.where(is_sound, packet.samples, np.float32(0)), gap=True)
        self._next_sample = packet.first_sample + len(packet.samples)

    def _push_eye(self, packet: EyePacket) -> None:
        check_eye(packet)
        expected = self._next_counter[packet.eye]
        if expected is not None and packet.counter > expected:
            self.lost_pictures += packet.counter - expected
        self._next_counter[packet.eye] = packet.counter + 1
        self._waiting[packet.eye].append(packet)

    def _append(
        self,
        samples: NDArray[np.float32],  # [n]
        *,
        gap: bool,
    ) -> None:
        done = 0
        while done < len(samples):
            n = min(SAMPLES_PER_FRAME - self._fill, len(samples) - done)
            self._audio[self._fill : self._fill + n] = samples[done : done + n]
            self._gap |= gap
            self._fill += n
            self._position += n
            done += n
            if self._fill == SAMPLES_PER_FRAME:
                self._finish_frame()

    def _finish_frame(self) -> None:
        t_ns = self._time_at(self._position)
        if self._last_t_ns is not None:
            t_ns = max(t_ns, self._last_t_ns + 1)
        eyes, valid, age_ns = self._eyes_at(t_ns)
        while self._emotions and self._emotions[0].t_ns <= t_ns:
            self._emotion = self._emotions.popleft().words
        head, head_valid, head_age_ns = self._head_at(t_ns)
        self._frames.append(
            SensorFrame(
                index=self._index,
                t_ns=t_ns,
                audio=self._audio,
                eyes=eyes,
                eyes_valid=valid,
                eyes_age_ns=age_ns,
                audio_gap=self._gap,
                emotion=self._emotion,
                head=head,
                head_valid=head_valid,
                head_age_ns=head_age_ns,
                gaze=self._pose.gaze if self._pose and head_valid else None,
                requests=self._requests,
            )
        )
        self._index += 1
        self._last_t_ns = t_ns
        self._audio = np.zeros(SAMPLES_PER_FRAME, np.float32)
        self._fill, self._gap, self._requests = 0, False, ()

    def _eyes_at(
        self, t_ns: int
    ) -> tuple[NDArray[np.uint8] | None, NDArray[np.bool_], NDArray[np.int64]]:
        """Newest picture of each eye with time <= t_ns: pictures, valid [2], age [2]."""
        valid, age_ns = np.zeros(2, np.bool_), np.full(2, -1, np.int64)
        for eye, waiting in enumerate(self._waiting):
            while waiting and waiting[0].t_ns <= t_ns:
                self._shown[eye] = waiting.popleft()
        if self._shown == [None, None]:
            return None, valid, age_ns
        eyes = np.empty((2, EYE_SIZE, EYE_SIZE), np.uint8)
        for eye, packet in enumerate(self._shown):
            eyes[eye] = packet.image if packet else 0
            if packet is not None:
                age_ns[eye] = t_ns - packet.t_ns
                valid[eye] = age_ns[eye] <= self._eye_tolerance_ns
        return eyes, valid, age_ns

    def _head_at(self, t_ns: int) -> tuple[HeadPose | None, bool, int]:
        """Newest pose with time <= t_ns: pose, valid, age."""
        while self._poses and self._poses[0].t_ns <= t_ns:
            self._pose = self._poses.popleft()
        if self._pose is None:
            return None, False, -1
        age_ns = t_ns - self._pose.t_ns
        return self._pose.pose, self._pose.valid and age_ns <= HEAD_TOLERANCE_NS, age_ns

    def _time_at(self, position: int) -> int:
        return self._anchor_t_ns + (position - self._anchor_position) * NS // SAMPLE_RATE


def check_audio(packet: AudioPacket) -> None:
    """Raise unless the samples are [n] float32. Their values may be anything."""
    if packet.samples.ndim != 1 or packet.samples.dtype != np.float32:
        raise InputError(
            f"audio packet: expected samples [n] float32, "
            f"got {list(packet.samples.shape)} {packet.samples.dtype}; convert in the source"
        )


def check_eye(packet: EyePacket) -> None:
    """Raise unless the picture is [400, 400] uint8 of eye 0 or 1."""
    if packet.eye not in (0, 1):
        raise InputError(f"eye packet: expected eye 0 (left) or 1 (right), got {packet.eye}")
    if packet.image.shape != (EYE_SIZE, EYE_SIZE) or packet.image.dtype != np.uint8:
        raise InputError(
            f"eye packet: expected a picture [{EYE_SIZE}, {EYE_SIZE}] uint8, "
            f"got {list(packet.image.shape)} {packet.image.dtype}; crop or scale in the source"
        )
