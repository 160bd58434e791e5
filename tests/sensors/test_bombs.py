"""Small files that would take gigabytes, numbers that no sensor gives: told, not raised."""

import json
import zipfile
from pathlib import Path

import av
import numpy as np
import pytest

from sensors import files
from sensors.session import format as session_format
from sensors.session.eye_video import open_video
from sensors.session.timeline import read_timeline
from sensors.types import InputError


def test_json_nested_too_deeply_is_bad_json(tmp_path: Path) -> None:
    """Red before: RecursionError."""
    path = tmp_path / "card.json"
    path.write_text("[" * 200_000)
    with pytest.raises(ValueError, match="nested"):
        files.read_json(path)
    path.write_bytes(b'"' + b"x" * files.MAX_JSON + b'"')
    with pytest.raises(ValueError, match="more than"):
        files.read_json(path)


@pytest.mark.slow
def test_an_npz_that_unpacks_to_gigabytes_is_refused(tmp_path: Path) -> None:
    """Red before: 6 MB took 6.5 GB."""
    path = tmp_path / "bomb.npz"
    squeezed = zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1)
    with squeezed as archive, archive.open("vertices.npy", "w", force_zip64=True) as entry:
        np.lib.format.write_array_header_1_0(
            entry, {"descr": "<f8", "fortran_order": False, "shape": (1 << 27,)}
        )
        for _ in range(48):
            entry.write(bytes(1 << 24))
    assert path.stat().st_size < 8 << 20
    with pytest.raises(ValueError, match="more than"):
        files.load_npz(path)


def test_an_npz_that_claims_too_much_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "claim.npz"
    with zipfile.ZipFile(path, "w") as archive, archive.open("vertices.npy", "w") as entry:
        np.lib.format.write_array_header_1_0(
            entry, {"descr": "<f8", "fortran_order": False, "shape": (10**12, 3)}
        )
    with pytest.raises(ValueError):
        files.load_npz(path)


def test_a_video_of_huge_pictures_is_refused(tmp_path: Path) -> None:
    """Red before: 2.4 MB took 3.9 GB."""
    path = tmp_path / "huge.mkv"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("ffv1", rate=30)
        stream.width, stream.height, stream.pix_fmt = 4400, 64, "gray"
        frame = av.VideoFrame.from_ndarray(np.zeros((64, 4400), np.uint8), format="gray")
        for packet in [*stream.encode(frame), *stream.encode(None)]:
            container.mux(packet)
    with pytest.raises(InputError, match="4400 x 64"):
        open_video(path)


@pytest.mark.parametrize(
    "line",
    [
        {"stream": "audio", "t_ns": 1e30, "first_sample": 0, "num_samples": 1, "offset": 0},
        {"stream": "audio", "t_ns": 10**30, "first_sample": 0, "num_samples": 1, "offset": 0},
        {"stream": "audio", "t_ns": 0, "first_sample": 0, "num_samples": True, "offset": 0},
        {"stream": "eye_left", "t_ns": 0, "counter": -(10**30), "picture": 0},
        {"stream": ["audio"], "t_ns": 0},
        {"stream": "request", "t_ns": 0, "wanted": "rm"},
        {"stream": "request", "t_ns": 0, "wanted": ["reset"]},
        ["audio"],
        "[" * 100_000,
    ],
)
def test_numbers_that_no_sensor_gives_are_bad_lines(tmp_path: Path, line: object) -> None:
    fields = (
        line
        if isinstance(line, str)
        else json.dumps(line | {"gap": False} if isinstance(line, dict) else line)
    )
    (tmp_path / session_format.TIMELINE_FILE).write_text(fields + "\n")
    with pytest.raises(InputError, match="line 1"):
        read_timeline(tmp_path, closed=True)


@pytest.mark.parametrize("field", [{"devices": 5}, {"calibration": []}, {"version": True}])
def test_a_card_with_values_of_another_kind_is_refused(tmp_path: Path, field: dict) -> None:
    card = session_format.new_card("now", {}, {}, "ffv1", "PCM_16") | field
    (tmp_path / session_format.CARD_FILE).write_text(json.dumps(card))
    with pytest.raises(InputError, match=session_format.CARD_FILE):
        session_format.read_card(tmp_path)
