"""The fuzz of `bench`, short, and what its long runs found."""

import hashlib
import io
import json
import os
import struct
import warnings
import zipfile
from pathlib import Path

import numpy as np
import pytest

from app.bench.fuzz import chunk, run, targets
from app.bench.fuzz.chunk import Chunk, run_chunk
from app.bench.fuzz.fuzzer import Fuzzer
from app.bench.fuzz.run import measure_fuzz
from app.sinks.protocols.face import read_gains
from encoder.eyes.calibration import EyeCalibration
from render.avatars import ply, scan
from render.decoder.learned import weights_file
from sensors import files
from sensors.session.timeline import read_timeline
from sensors.types import InputError


@pytest.mark.slow
def test_a_little_fuzz_finds_nothing(tmp_path: Path) -> None:
    report = measure_fuzz(3000, 7, processes=2, folder=tmp_path)
    metrics = report["metrics"]
    assert metrics["escaped"] == metrics["hangs"] == [] and not metrics["died"]
    assert 2900 < metrics["inputs"] < 3100
    assert all(metrics[f"{name}_inputs"] for name in targets.TARGETS)
    assert all(bar["ok"] for bar in report["bars"])


def broken(fuzzer: Fuzzer, folder: Path):
    return lambda: json.loads(fuzzer.mutate(b"[1, 2]").decode("latin-1"))


def endless(fuzzer: Fuzzer, folder: Path):
    def feed() -> None:
        while fuzzer.pick(2) or True:
            pass

    return feed


def greedy(fuzzer: Fuzzer, folder: Path):
    sizes = iter((1, 200, 1))  # more than other tests of this process may give back meanwhile
    return lambda: len(os.urandom(next(sizes) << 20))


def test_what_escapes_hangs_or_takes_memory_is_found(monkeypatch, tmp_path: Path) -> None:
    monkeypatch.setattr(chunk, "HANG_S", 0.05)
    for name, make in (("serial", broken), ("http", endless), ("usb", greedy)):
        monkeypatch.setitem(targets.TARGETS, name, targets.Target(make, 1))
    done = run_chunk(Chunk("serial", 0, 20, 0), tmp_path)
    assert "JSONDecodeError" in done.escaped[0]
    assert list(tmp_path.glob("serial-0-*.bin"))
    assert run_chunk(Chunk("http", 0, 1, 0)).hangs == ["http 0:first", "http 0:0"]
    assert run_chunk(Chunk("usb", 0, 2, 0)).growth_mb > 60


def test_a_stopped_run_goes_on_where_it_was(monkeypatch, tmp_path: Path) -> None:
    asked: list[Chunk] = []

    def stopped(chunks, processes, folder):
        asked.extend(chunks)
        for one in chunks[: len(chunks) // 2]:
            done = chunk.Done(one)
            run._keep(folder, done)
            yield done

    monkeypatch.setattr(run, "_run", stopped)
    measure_fuzz(200_000, 3, folder=tmp_path)
    first, half = len(asked), len(asked) // 2
    report = measure_fuzz(200_000, 3, folder=tmp_path)
    assert len(asked) - first == first - half
    assert not set(asked[:half]) & set(asked[first:])
    assert report["metrics"]["inputs"] < 200_000  # of both, and no input twice
    measure_fuzz(200_000, 4, folder=tmp_path)  # another seed is another run
    assert len(asked) == 2 * first + first - half
    (tmp_path / run.KEPT).write_text("{}")
    with pytest.raises(InputError, match="name another folder"):
        measure_fuzz(1000, 3, folder=tmp_path)


def test_the_fuzzer_changes_its_input() -> None:
    data = bytes(range(256))
    mutated = [Fuzzer(seed).mutate(data) for seed in range(40)]
    assert sum(m != data for m in mutated) > 35
    assert b"".join(Fuzzer(1).pieces(data)) == data
    assert Fuzzer(5, 2).mutate(data) == Fuzzer(5, 2).mutate(data)


def archive(path: Path, array: bytes) -> Path:
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("vertices.npy", array)
    return path


def test_an_npz_whose_arrays_are_none_is_refused(tmp_path: Path) -> None:
    """Found by the fuzz: AttributeError and TokenError."""
    with pytest.raises(ValueError, match="not an array"):
        files.load_npz(archive(tmp_path / "a.npz", b"just bytes"))
    whole = io.BytesIO()
    np.save(whole, np.zeros(3))
    cut = whole.getvalue().replace(b"(3,)", b"(3, ")
    with pytest.raises(ValueError, match="no whole npz"):
        files.load_npz(archive(tmp_path / "b.npz", cut))


HUGE = "1" + "0" * 400  # a whole number that no float holds


def test_numbers_too_large_for_a_float_are_refused(tmp_path: Path) -> None:
    """Found by the fuzz: OverflowError."""
    (tmp_path / "timeline.jsonl").write_text(
        f'{{"stream":"head","t_ns":0,"position":[{HUGE},0,0],"quat":[1,0,0,0],"valid":true}}\n'
    )
    with pytest.raises(InputError, match="bad line 1"):
        read_timeline(tmp_path, closed=True)
    (tmp_path / "gains.json").write_text(f'{{"jawOpen": {{"gain": {HUGE}}}}}')
    with pytest.raises(InputError, match="numbers up to 1000"):
        read_gains(tmp_path / "gains.json")
    words = json.dumps(EyeCalibration().to_json()).replace("1.0", HUGE, 1)
    (tmp_path / "eyes.json").write_text(words)
    with pytest.raises(InputError, match="run `livedrive calibrate` again"):
        EyeCalibration.load(tmp_path / "eyes.json")


@pytest.mark.parametrize("descr", ["'<f8'", "b'<f8'"])
def test_npz_headers_that_numpy_stumbles_over_are_refused(tmp_path: Path, descr: str) -> None:
    """Found by the fuzz: OverflowError, TypeError."""
    shape = f"({HUGE},)" if descr == "'<f8'" else "(3,)"
    name = "'shape'" if descr == "'<f8'" else "b'shape'"
    header = f"{{'descr': {descr}, 'fortran_order': False, {name}: {shape}, }}".encode()
    data = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + bytes(24)
    with pytest.raises(ValueError):
        files.load_npz(archive(tmp_path / "a.npz", data))


@pytest.mark.parametrize("shape", ["(9223372036854775808, 1)", "(3L,)"])
def test_a_hostile_npz_writes_no_warning(tmp_path: Path, shape: str) -> None:
    """Found by the fuzz: "invalid value encountered in reduce", "was created on Python 2"."""
    header = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}".encode()
    data = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + bytes(24)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        with pytest.raises(ValueError, match="no whole npz"):
            files.load_npz(archive(tmp_path / "a.npz", data))
    assert told == []


def test_an_encrypted_npz_is_refused(tmp_path: Path) -> None:
    """Found by the fuzz: RuntimeError."""
    path = archive(tmp_path / "a.npz", b"12345678")
    data = bytearray(path.read_bytes())
    data[6] |= 1  # the entry's flags, and those of the directory
    data[data.index(b"PK\x01\x02") + 8] |= 1
    path.write_bytes(bytes(data))
    with pytest.raises(ValueError, match="encrypted"):
        files.load_npz(path)


@pytest.mark.parametrize("odd", ["doubled", "count"])
def test_a_ply_with_an_odd_header_is_refused(tmp_path: Path, odd: str) -> None:
    """Found by the fuzz: ValueError."""
    count = "9" * 5000 if odd == "count" else "1"
    words = ["ply", "format binary_little_endian 1.0", f"element vertex {count}"]
    words += ["property float x", "property float x", "end_header", ""]
    (tmp_path / "head.ply").write_bytes("\n".join(words).encode() + bytes(8))
    with pytest.raises(InputError, match="export it again"):
        ply.load(tmp_path / "head.ply")


@pytest.mark.parametrize("odd", ["list uchar int neighbours", "half w"])
def test_a_ply_with_properties_of_unknown_length_is_refused(tmp_path: Path, odd: str) -> None:
    """Red before: it was passed over, and every vertex after the first read from a wrong place."""
    words = ["ply", "format binary_little_endian 1.0", "element vertex 2", f"property {odd}"]
    words += [*(f"property float {name}" for name in ply.FIELDS), "end_header", ""]
    (tmp_path / "head.ply").write_bytes("\n".join(words).encode() + bytes(1000))
    with pytest.raises(InputError, match=f"got 'property {odd}'; export it as 3DGS PLY"):
        ply.load(tmp_path / "head.ply")


def test_weights_of_a_type_that_numpy_lacks_are_refused(tmp_path: Path) -> None:
    header = b'{"a":{"dtype":"F8_E5M2","shape":[1],"data_offsets":[0,1]}}'
    (tmp_path / "w.safetensors").write_bytes(struct.pack("<Q", len(header)) + header + bytes(1))
    data = (tmp_path / "w.safetensors").read_bytes()
    digest = hashlib.sha256(data).hexdigest()
    (tmp_path / "w.json").write_text(json.dumps({"kind": "prior", "sha256": digest}))
    with pytest.raises(InputError, match="expected safetensors"):
        weights_file.load(tmp_path / "w", "prior")


def test_a_scan_as_wide_as_a_house_is_no_head() -> None:
    places = np.random.default_rng(0).uniform(0, 300, (40, 3))
    places[3, 0] = 1e30
    faces = np.array([[k, k + 1, k + 2] for k in range(38)], np.int32)
    with pytest.raises(InputError, match="expected a head and neck"):
        scan.check_geometry(places, faces, "scan")
