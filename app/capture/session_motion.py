"""Motion beside a session: `session create --livelink take.csv` keeps a phone's curves as truth.

The curves go to motion.npz in the session's folder at 30 FPS: ARKit's 52 columns, the rig, the
tongue and the gaze. Where a take has no sound, silence is put in its place.
"""

# pyright: reportMissingTypeStubs=false

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from sensors import files
from sensors.session.format import MOTION_FILE
from sensors.types import FPS, NS, SAMPLE_RATE, InputError

if TYPE_CHECKING:
    from encoder.capture.subjects.livelink import LivelinkTake

EARLY_END_S = 0.5  # the sound may end this much before the curves
MAX_YAW_DEG, MAX_PITCH_DEG = 30.0, 25.0  # of a full eyeLook curve


def read_take(path: Path, audio: Path | None) -> "LivelinkTake":
    """The take; raise InputError when its sound is shorter than its curves."""
    from encoder.capture.subjects.livelink import read_livelink

    take = read_livelink(path)
    if audio is not None:
        seconds = _seconds(audio)
        if seconds is not None and seconds < take.times[-1] - EARLY_END_S:
            raise InputError(
                f"{audio}: expected at least the {take.times[-1]:.1f} s of {path.name}, "
                f"got {seconds:.1f} s; cut the take or find the whole sound"
            )
    return take


def _seconds(audio: Path) -> float | None:
    """None where it is not known; `session create` says what is wrong with the sound."""
    import soundfile

    from sensors.session.av_sound import AvSound

    try:
        return float(soundfile.info(audio).duration)
    except (soundfile.LibsndfileError, TypeError):  # TypeError: of a .raw
        pass
    try:
        with AvSound(audio) as sound:
            return sound.seconds
    except InputError:
        return None


def silence(path: Path, take: "LivelinkTake") -> Path:
    """Write a silent sound file as long as the take."""
    import soundfile

    count = int(np.ceil(take.times[-1] * FPS) + 1) * SAMPLE_RATE // FPS
    soundfile.write(files.create(path), np.zeros(count, np.float32), SAMPLE_RATE)
    return path


def write_motion(folder: Path, take: "LivelinkTake", frames: int) -> None:
    """motion.npz for a session of `frames` frames; the last row of the take is held."""
    from app.face.arkit import ARKIT_NAMES
    from encoder.capture.motion.channels import RIG_NAMES, TONGUE_NAMES

    rig, tongue = take.rig(frames)
    weights, columns = take.at_frames(frames), {name: k for k, name in enumerate(take.names)}
    arkit = np.zeros((frames, len(ARKIT_NAMES)), np.float32)
    for k, name in enumerate(ARKIT_NAMES):
        if name in columns:
            arkit[:, k] = weights[:, columns[name]]
    with files.replacing(folder / MOTION_FILE, private=True) as draft:
        np.savez_compressed(
            draft,
            t_ns=(np.arange(frames, dtype=np.int64) + 1) * NS // FPS,
            rig=rig.astype(np.float16),
            rig_names=np.array(RIG_NAMES),
            tongue=tongue.astype(np.float16),
            tongue_names=np.array(TONGUE_NAMES),
            gaze=_gaze(rig).astype(np.float16),
            arkit=arkit,
            arkit_names=np.array(ARKIT_NAMES),
        )


def _gaze(rig: NDArray[np.float32]) -> NDArray[np.float32]:
    """[T, 53] -> [T, 2, 3] unit vectors, from the eyeLook curves."""
    from encoder.capture.motion.channels import RIG_INDEX

    gaze = np.zeros((len(rig), 2, 3), np.float32)
    for eye, (side, outward) in enumerate((("L", 1), ("R", -1))):
        out, in_, up, down = (
            rig[:, RIG_INDEX[f"eyeLook{name}_{side}"]] for name in ("Out", "In", "Up", "Down")
        )
        yaw = np.radians(MAX_YAW_DEG) * outward * (out - in_)
        pitch = np.radians(MAX_PITCH_DEG) * (up - down)
        gaze[:, eye] = np.stack(
            [np.sin(yaw) * np.cos(pitch), np.sin(pitch), np.cos(yaw) * np.cos(pitch)], 1
        )
    return gaze
