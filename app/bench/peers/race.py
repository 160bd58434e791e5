"""First frame from new sound, live: ours and every peer, in one run and on one thread.

Networks have the published shapes and random weights, and all run in ONNX Runtime at 32 bits. Live
delay is what a peer waits for and then computes. Who is causal is shown, not believed: where the
last sound is NaN, the frames before it must stay finite.
"""

import logging
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from app.terminal.thresholds import at_most

if TYPE_CHECKING:
    from torch import nn

    from app.bench.peers.table import Peer, Stage
    from encoder.backends import Networks

ROUNDS = 5
TICKS = 90
TICK_S = 1 / 30
MARGIN = 2  # frames: where one ends is told differently
MAX_RATIO = 0.2  # ours to the fastest peer


def measure_peers(seed: int) -> dict[str, Any]:
    """The report holds metrics and thresholds."""
    from rich.table import Table
    from tqdm import tqdm

    from app.bench.peers.table import PEERS, QUOTED
    from app.terminal.console import console

    metrics: dict[str, Any] = {}
    for name, networks, int8 in _ours(seed):
        metrics[name] = _streamed(networks, seed, int8=int8)
    for peer in tqdm(PEERS, unit="peer", disable=None):
        metrics[peer.name] = _raced(peer, seed)
    for quoted in QUOTED:  # nothing is known of what it takes to compute
        metrics[quoted.name] = _row(quoted.waits_s, 0.0, causal=False)
        del metrics[quoted.name]["computes_ms"]
    ours = metrics["ours, 32 bits"]["live_ms"]
    table = Table(
        "first frame from new sound", "waits ms", "computes ms", "live ms", "x ours", "causal"
    )
    for name, row in metrics.items():
        row["times_ours"] = row["live_ms"] / ours
        shown = (row.get(key) for key in ("waits_ms", "computes_ms", "live_ms"))
        cells = ["-" if value is None else f"{value:,.1f}" for value in shown]
        cells.append(f"x {row['times_ours']:,.1f}")
        table.add_row(name, *cells, "yes" if row["causal"] else "no")
    console().print(table)
    fastest = min(metrics[peer.name]["live_ms"] for peer in (*PEERS, *QUOTED))
    return {
        "metrics": {
            f"{name}/{k}": value for name, row in metrics.items() for k, value in row.items()
        },
        "peers": [{k: v for k, v in asdict(peer).items() if k != "stages"} for peer in PEERS],
        "quoted": [asdict(peer) for peer in QUOTED],
        "bars": [at_most("ours over the fastest peer", ours / fastest, MAX_RATIO)],
    }


def _ours(seed: int) -> "list[tuple[str, Networks, bool]]":
    """Name, networks and whether weights are whole numbers."""
    from encoder.audio import config as audio
    from encoder.backends import Networks
    from encoder.denoiser import config as denoiser
    from encoder.inference import load_networks

    shipped, _ = load_networks()
    ears, thinker = audio.PRESETS["paper"], denoiser.PRESETS["paper"]
    thinker = replace(thinker, audio_dim=ears.width)
    rng = np.random.default_rng(seed)
    paper = Networks(
        ears, _random(audio.weight_shapes(ears), rng),
        thinker, _random(denoiser.weight_shapes(thinker), rng),
    )  # fmt: skip
    sizes = ("ours", shipped), ("ours at the paper's size", paper)
    return [
        (f"{name}, {'8' if int8 else '32'} bits", networks, int8)
        for name, networks in sizes
        for int8 in (False, True)
    ]


def _random(shapes: dict[str, tuple[int, ...]], rng: np.random.Generator) -> dict[str, Any]:
    made: dict[str, Any] = {}
    for name, shape in shapes.items():
        if name.endswith(("running_var", "prior")):
            made[name] = np.ones(shape, np.float32)
        else:
            inputs = max(1, int(np.prod(shape[1:])))
            made[name] = (rng.standard_normal(shape) / inputs**0.5).astype(np.float32)
    return made


def _streamed(networks: "Networks", seed: int, *, int8: bool) -> dict[str, Any]:
    """A tick at a time, 30 a second: weights are as cold as they are live."""
    from encoder.backends import OnnxBackend
    from sensors.types import SAMPLES_PER_FRAME

    backend, rng = OnnxBackend(networks, int8=int8), np.random.default_rng(seed)
    condition = np.zeros(networks.config.condition_dim, np.float32)
    sound = rng.standard_normal((TICKS, SAMPLES_PER_FRAME)).astype(np.float32) * np.float32(0.1)
    noise = rng.standard_normal((TICKS, networks.config.expression_dim)).astype(np.float32)

    def drive(heard: np.ndarray, pace_s: float) -> tuple[list[np.ndarray], list[float]]:
        state, codes, times = backend.init_state(), list[np.ndarray](), list[float]()
        for k in range(TICKS):
            start = time.perf_counter()
            features, state = backend.audio(heard[k], state)
            code, state = backend.denoise(noise[k], features, condition, state)
            times.append(time.perf_counter() - start)
            codes.append(code)
            time.sleep(max(0.0, pace_s - times[-1]))
        return codes, times

    codes, times = drive(sound, TICK_S)
    broken = sound.copy()
    broken[-15:] = np.nan
    after, _ = drive(broken, 0.0)
    causal = all(np.array_equal(a, b) for a, b in zip(codes[:-15], after[:-15], strict=True))
    return _row(0.0, float(np.median(times[TICKS // 3 :])), causal=causal)


def _row(waits_s: float, computes_s: float, *, causal: bool) -> dict[str, Any]:
    live = waits_s + computes_s
    return {
        "waits_ms": 1e3 * waits_s,
        "computes_ms": 1e3 * computes_s,
        "live_ms": 1e3 * live,
        "causal": causal,
    }


def _raced(peer: "Peer", seed: int) -> dict[str, Any]:
    total, causal = 0.0, True
    for i, stage in enumerate(peer.stages):
        run, inputs = _exported(stage, seed)
        total += stage.times * min(_timed(run, inputs) for _ in range(ROUNDS))
        if i == 0:
            causal = _sees_no_future(run, inputs)
    return _row(peer.waits_s, total, causal=causal)


def _exported(
    stage: "Stage", seed: int
) -> tuple[Callable[[list[np.ndarray]], np.ndarray], list[np.ndarray]]:
    """The stage in ONNX Runtime, and something for it to read."""
    import torch as typed

    from encoder.nn.onnx_session import session

    torch: Any = typed  # its own annotations are not whole
    logging.getLogger("torch.onnx").setLevel(logging.ERROR)
    torch.manual_seed(seed)
    module: nn.Module = stage.build().eval()
    inputs = [torch.randn(shape) for shape in stage.inputs]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "peer.onnx"
        torch.onnx.export(
            module, tuple(inputs), str(path), dynamo=True, optimize=False, verbose=False
        )
        made = session(path)
    names = [entry.name for entry in made.get_inputs()]

    def run(values: list[np.ndarray]) -> np.ndarray:
        return made.run(None, dict(zip(names, values, strict=True)))[0]

    return run, [x.numpy() for x in inputs]


def _timed(run: Callable[[list[np.ndarray]], np.ndarray], inputs: list[np.ndarray]) -> float:
    start = time.perf_counter()
    run(inputs)
    return time.perf_counter() - start


def _sees_no_future(
    run: Callable[[list[np.ndarray]], np.ndarray], inputs: list[np.ndarray]
) -> bool:
    """Do the frames before it stay finite when the last eighth of what is heard is NaN?"""
    broken = [x.copy() for x in inputs]
    broken[0][:, -(broken[0].shape[1] // 8) :] = np.nan
    out = run(broken)
    before = out.shape[1] - out.shape[1] // 8 - MARGIN
    return bool(np.isfinite(out[:, :before]).all())
