"""Any sound file as 48 kHz mono blocks, any eye video as 400 x 400 pictures: checked, never whole.

Flow: files -> sound_blocks, eye_pictures -> session.create. The resampling here may look ahead
(soxr HQ): it happens before a session exists, and the live path never sees it.
"""

# pyright: reportMissingTypeStubs=false
import struct
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from sensors.picture import gray
from sensors.session.av_sound import AvSound
from sensors.session.eye_video import SIDE_BY_SIDE, open_video
from sensors.session.opening import check_there, start_s
from sensors.types import EYE_SIZE, FPS, NS, SAMPLE_RATE, InputError

CLIPPED_LEVEL = 0.9999
CLIPPED_SHARE = 1e-4  # of all samples; a file normalised to full scale stays below
MIN_CLEAN_RATE = 16_000
SILENT_RMS = 1e-5  # less than half a step of 16 bits
DEAD_SHARE = 1e-4  # of the loudest channel's power: no microphone was there, only its input
CANCELLED_SHARE = 0.05  # of the channels' power that their mean keeps; unlike ones keep half
MIN_PICTURE = 32
TIME_ROUNDING_NS = 1_500_000  # Matroska keeps milliseconds


def sound_blocks(path: Path, warnings: list[str]) -> Iterator[NDArray[np.float32]]:
    """Blocks [n] float32 -1..1 of 48 kHz mono; at the end `warnings` has what is doubtful."""
    import soxr

    live = _live_channels(path)
    with _open_sound(path) as file:
        rate, expected = int(file.samplerate), int(file.frames)
        if rate < MIN_CLEAN_RATE:
            warnings.append(f"{path}: {rate} Hz sound has nothing above {rate // 2} Hz")
        resampler = soxr.ResampleStream(rate, SAMPLE_RATE, 1, dtype="float32", quality="HQ")
        read, clipped, power, mono_power = 0, 0, 0.0, 0.0
        while len(block := _read(path, file, rate)):
            if not np.isfinite(block).all():
                bad = read + int(np.argmin(np.isfinite(block).all(1)))
                raise InputError(
                    f"{path}: expected finite samples, got NaN or infinity at "
                    f"{bad / rate:.3f} s; export the sound again"
                )
            read += len(block)
            block = block[:, live]
            clipped += int((np.abs(block) >= CLIPPED_LEVEL).any(1).sum())
            mono = block.mean(1, dtype=np.float32)
            power += float(np.square(block).mean(1).sum())
            mono_power += float(np.square(mono).sum())
            yield np.clip(mono if rate == SAMPLE_RATE else resampler.resample_chunk(mono), -1, 1)
        if expected - read > rate // 10:
            raise _truncated(path, f"{expected} samples", str(read))
        if rate != SAMPLE_RATE:
            rest = resampler.resample_chunk(np.zeros(0, np.float32), last=True)
            yield np.clip(rest, -1, 1)
    if clipped > CLIPPED_SHARE * read:
        warnings.append(
            f"{path}: {100 * clipped / read:.2f} % of the samples are clipped; "
            "record again with a lower level"
        )
    if power <= SILENT_RMS**2 * read:
        warnings.append(f"{path}: the sound is silent; check the file, or record it again")
    elif mono_power < CANCELLED_SHARE * power:
        warnings.append(
            f"{path}: its channels cancel each other, next to nothing is left of the sound; give "
            "one of them alone"
        )


def eye_pictures(
    path: Path,
    half: Literal["left", "right"] | None = None,  # of a video that shows both eyes side by side
) -> Iterator[tuple[int, NDArray[np.uint8]]]:
    """(time, picture [400, 400]) of any video. The exposure of the first picture starts at 0, or as
    much later as its stream does than the sound of the same file.

    A picture exists when its frame interval is over, as a SensorFrame does: picture k of a 30 FPS
    video is what frame k sees, one to one. Times come from the picture count wherever the
    container's own time agrees with it, because Matroska rounds to milliseconds.
    """
    from av import error as av_error

    with open_video(path) as container:
        stream = container.streams.video[0]
        width, height = stream.codec_context.width, stream.codec_context.height
        if min(width, height) < MIN_PICTURE:
            raise InputError(
                f"{path}: expected pictures of at least {MIN_PICTURE} x {MIN_PICTURE}, got "
                f"{width} x {height}; check the file"
            )
        if half and width < SIDE_BY_SIDE * height:
            raise InputError(
                f"{path}: expected both eyes side by side, about twice as wide as high, got "
                f"{width} x {height}; give two videos, left and right"
            )
        rate = Fraction(stream.average_rate or stream.guessed_rate or FPS)
        first_pts, count, late = None, 0, start_s(container, stream)
        frames = container.decode(stream)
        while True:
            try:
                frame = next(frames)
            except (StopIteration, av_error.FFmpegError):
                break  # a cut-off video is a video that ends early
            count += 1
            t_ns = count * NS * rate.denominator // rate.numerator
            if frame.pts is not None and frame.time_base is not None:
                first_pts = frame.pts if first_pts is None else first_pts
                seconds = (frame.pts - first_pts) * frame.time_base + 1 / rate
                own_ns = int(seconds * NS)
                t_ns = t_ns if abs(own_ns - t_ns) <= TIME_ROUNDING_NS else own_ns
            yield t_ns + round(late * NS), _square(frame, half)
    if count == 0:
        raise InputError(f"{path}: expected eye pictures, got none that decode; check the file")


def _live_channels(path: Path) -> NDArray[np.bool_]:
    """Which channels hold sound: a mean with silent ones would make it quieter."""
    powers: list[NDArray[np.float64]] = []
    with _open_sound(path) as file:
        rate = int(file.samplerate)
        while len(block := _read(path, file, rate)):
            powers.append(np.square(block, dtype=np.float64).sum(0))
            if len(powers[0]) == 1:
                break
    if not powers or len(powers[0]) == 1:
        return np.ones(1, bool)
    power = np.stack(powers).sum(0)
    loud = power > DEAD_SHARE * float(power.max())
    return loud if loud.any() else np.ones(len(power), bool)  # silence, or what is no number


def _square(frame: Any, half: str | None) -> NDArray[np.uint8]:
    """[400, 400] from the centre square of a video frame, or of its half."""
    import av

    image = gray(frame)
    if half:
        middle = image.shape[1] // 2
        image = image[:, :middle] if half == "left" else image[:, middle:]
    height, width = image.shape
    side = min(height, width)
    top, left = (height - side) // 2, (width - side) // 2
    image = image[top : top + side, left : left + side]
    if side == EYE_SIZE:
        return image
    scaled = av.VideoFrame.from_ndarray(np.ascontiguousarray(image), format="gray").reformat(
        EYE_SIZE, EYE_SIZE, interpolation="AREA" if side > EYE_SIZE else "BICUBIC"
    )
    return gray(scaled)


def _open_sound(path: Path) -> Any:
    import soundfile

    check_there(path, "a sound file")
    _check_riff(path)
    try:
        file = soundfile.SoundFile(str(path))
    except (soundfile.LibsndfileError, TypeError):
        return AvSound(path)
    if file.frames == 0:
        file.close()
        raise InputError(f"{path}: expected sound, got an empty file (0 samples); record it again")
    return file


def _read(path: Path, file: Any, num: int) -> NDArray[np.float32]:
    import soundfile

    try:
        return file.read(num, dtype="float32", always_2d=True)
    except soundfile.LibsndfileError as error:
        raise _truncated(path, f"{file.frames} samples", str(error)) from None


def _check_riff(path: Path) -> None:
    """libsndfile reads a truncated WAV without an error, so compare its header with its size."""
    size = path.stat().st_size
    with path.open("rb") as file:
        riff, _, wave = struct.unpack("<4sI4s", file.read(12).ljust(12, b"\0"))
        if (riff, wave) != (b"RIFF", b"WAVE"):
            return
        while len(head := file.read(8)) == 8:
            name, length = struct.unpack("<4sI", head)
            if name == b"data":
                streamed = length >= 0x7FFFFF00  # written to a pipe, length unknown
                if not streamed and file.tell() + length > size:
                    raise _truncated(path, f"{length} bytes", str(size - file.tell()))
                return
            file.seek(length + length % 2, 1)
    raise _truncated(path, "a data chunk", "none")


def _truncated(path: Path, expected: str, got: str) -> InputError:
    return InputError(f"{path} is truncated: expected {expected}, got {got}; copy the file again")
