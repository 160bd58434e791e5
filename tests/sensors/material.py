"""Packets, sound files and eye videos made on the spot for the sensor tests."""

from fractions import Fraction
from pathlib import Path

import numpy as np
import soundfile
from numpy.typing import NDArray

from sensors.session.files import replay_frames
from sensors.session.recording import Recording
from sensors.types import EYE_SIZE, NS, SAMPLE_RATE, AudioPacket, EyePacket, Packet, SensorFrame


def image(seed: int) -> NDArray[np.uint8]:
    """[400, 400] noise: any lossy step on the way shows."""
    return np.random.default_rng(seed).integers(0, 256, (EYE_SIZE, EYE_SIZE), np.uint8)


def packets(seconds: float, *, start_ns: int = 987_654_321, block: int = 480) -> list[Packet]:
    """Microphone blocks and two cameras (30 and 60 Hz, late and jittery) in order of arrival."""
    rng = np.random.default_rng(5)
    arrivals: list[tuple[int, int, Packet]] = []
    for first in range(0, int(seconds * SAMPLE_RATE), block):
        samples = rng.uniform(-1, 1, block).astype(np.float32)
        t_ns = start_ns + first * NS // SAMPLE_RATE
        arrivals.append((t_ns + block * NS // SAMPLE_RATE, 9, AudioPacket(t_ns, first, samples)))
    for eye, rate in ((0, 30), (1, 60)):
        for k in range(int(seconds * rate)):
            t_ns = start_ns + k * NS // rate + int(rng.integers(0, 3_000_000))
            arrivals.append((t_ns + 12_000_000, eye, EyePacket(t_ns, eye, k, image(2 * k + eye))))
    return [packet for *_, packet in sorted(arrivals, key=lambda a: a[:2])]


def tone(seconds: float, rate: int = SAMPLE_RATE, channels: int = 1) -> NDArray[np.float32]:
    """[n, channels] 220 Hz at half scale."""
    t = np.arange(int(seconds * rate)) / rate
    mono = 0.5 * np.sin(2 * np.pi * 220 * t)
    return np.repeat(mono[:, None], channels, 1).astype(np.float32)


def wav(path: Path, seconds: float = 1.0, rate: int = SAMPLE_RATE, channels: int = 1) -> Path:
    soundfile.write(path, tone(seconds, rate, channels), rate)
    return path


def video(
    path: Path,
    num: int = 30,
    *,
    rate: int = 30,
    width: int = EYE_SIZE,
    height: int = EYE_SIZE,
    codec: str = "ffv1",
) -> Path:
    """Picture k is uniformly grey of value 5 * k."""
    import av

    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=rate)
        stream.width, stream.height = width, height
        stream.pix_fmt = "gray" if codec == "ffv1" else "yuv420p"
        for k in range(num):
            grey = np.full((height, width), 5 * k % 256, np.uint8)
            frame = av.VideoFrame.from_ndarray(grey, format="gray")
            frame.pts, frame.time_base = k, Fraction(1, rate)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


def same_packet(a: Packet, b: Packet) -> bool:
    if isinstance(a, AudioPacket) and isinstance(b, AudioPacket):
        same = np.array_equal(a.samples, b.samples)
        return same and (a.t_ns, a.first_sample, a.gap) == (b.t_ns, b.first_sample, b.gap)
    if isinstance(a, EyePacket) and isinstance(b, EyePacket):
        same = np.array_equal(a.image, b.image)
        return same and (a.t_ns, a.eye, a.counter) == (b.t_ns, b.eye, b.counter)
    return False


def frames(folder: Path) -> list[SensorFrame]:
    with Recording(folder) as recording:
        return list(replay_frames(recording))
