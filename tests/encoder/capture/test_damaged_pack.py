"""A data set that a full disk or a bad copy has damaged: one line says what, and the cure.

Red before: tracebacks of zipfile, json, mmap, or shapes that did not fit an hour later.
"""

import errno
import sys
from pathlib import Path

import numpy as np
import pytest

from encoder.capture import dataset
from encoder.capture.motion.channels import RIG_NAMES
from encoder.training.streams import eye_pictures
from encoder.training.streams.wide_eyes import WidePictures
from sensors import files
from sensors.types import InputError


@pytest.fixture
def pack(tmp_path: Path) -> Path:
    rig, gaze = np.zeros((40, len(RIG_NAMES))), np.tile([0.0, 0.0, 1.0], (40, 2, 1))
    sound = np.zeros(40 * 1600)
    clip = dataset.make_clip(sound, rig, gaze, np.zeros(40), truth="rest", voice="none")
    shard = dataset.write_shard(tmp_path / "one", [clip])
    dataset.write_manifest(tmp_path, [shard], {"tones": "made by rules"})
    return tmp_path


@pytest.mark.parametrize("share", [0, 0.5, 0.95])
@pytest.mark.parametrize(
    ("name", "cure"),
    [
        ("manifest.json", "run livedrive capture .* again, which writes it anew"),
        ("one/subject.json", "remove .*one, and run livedrive capture .* again"),
        ("one/motion.npz", "remove .*one, and run livedrive capture .* again"),
        ("one/audio_24k.npy", "remove .*one, and run livedrive capture .* again"),
    ],
)
def test_a_cut_file_is_named_with_its_cure(pack: Path, name: str, cure: str, share: float) -> None:
    assert len(dataset.read_pack(pack)) == 1
    data = (pack / name).read_bytes()
    (pack / name).write_bytes(data[: int(share * len(data))])
    with pytest.raises(InputError, match=cure) as told:
        dataset.read_pack(pack)
    assert Path(name).stem in str(told.value) or "its sound" in str(told.value)


@pytest.mark.skipif(sys.platform == "win32", reason="no limit on a file's size there")
def test_a_full_disk_is_told_with_the_file(pack: Path) -> None:
    """Red before: `430400 requested and 180160 written`."""
    import resource

    clips, before = dataset.read_pack(pack), resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, before[1]))
    try:
        with pytest.raises(OSError, match="audio_24k.npy") as told:
            dataset.write_shard(pack / "two", clips)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert told.value.errno == errno.EFBIG and not list((pack / "two").iterdir())


def test_sound_of_another_length_is_told(pack: Path) -> None:
    np.save(pack / "one" / "audio_24k.npy", np.zeros(800 * 39, np.int16))
    with pytest.raises(InputError, match="expected 40 frames of sound and motion, got 39 and 40"):
        dataset.read_pack(pack)


def test_cut_eye_pictures_are_named_and_missing_ones_tell_the_option(tmp_path: Path) -> None:
    """Red before: zipfile's traceback; the option was called --eye-pairs, which there is none."""
    with pytest.raises(InputError, match="livedrive capture .* --eyes 40000"):
        eye_pictures.EyePictures.load(tmp_path)
    for name in ("eyes_000.npz", "wide_000.npz", "no_eyes.npz"):
        (tmp_path / name).write_bytes(b"PK\3\4 cut")
    with pytest.raises(InputError, match="eyes_000.npz: expected a whole npz .*; remove it"):
        eye_pictures.EyePictures.load(tmp_path)
    with pytest.raises(InputError, match="wide_000.npz: expected a whole npz .*; remove it"):
        WidePictures.load(tmp_path)


def test_an_array_that_is_missing_is_named(tmp_path: Path) -> None:
    np.savez(tmp_path / "some.npz", x=np.zeros(2))
    with pytest.raises(InputError, match="y is not a file.*; remove it"):  # noqa: SIM117
        with files.arrays(tmp_path / "some.npz", "remove it") as data:
            _ = data["y"]
