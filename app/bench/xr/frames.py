"""A stereo frame of the headset's loop, on the stand-in runtime: 1024 x 1024 an eye.

Drawn as fast as it goes, from reading the ticks to the last framebuffer: a face that moves, a
wearer who sways 700 mm before it, as in the headset.
"""

import time
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from app.xr.scene import Scene
    from render.gl.contexts import GLContext
    from render.types import Density

DENSITIES: "tuple[Density, ...]" = ("16k", "32k", "65k")
SIZE = (1024, 1024)  # px an eye
FRAMES, WARM_UP = 90, 10
SORTS = 50


def measure_frames(avatar: str) -> tuple[str, dict[str, float]]:
    """Name of the renderer, and metrics."""
    from rich.table import Table
    from tqdm import tqdm

    from app.terminal.console import console
    from app.xr.link import XrInfo
    from app.xr.scene import Scene
    from render.gl.contexts import create_context

    context = create_context()
    metrics: dict[str, float] = {}
    table = Table("on the head", "Gaussians", "stereo frame ms", "a sort ms")
    for density in tqdm(DENSITIES, unit="case", disable=None):
        scene = Scene(context, XrInfo("auto", avatar, gaussians=density), lambda: avatar)
        scene.close = lambda: None  # the context serves the next case, too
        times_ms, count = _frames_ms(context, scene), len(scene.cloud(0))
        sort_ms = _sort_ms(count)
        metrics |= {
            f"stereo_{density}_best_ms": round(min(times_ms), 3),
            f"stereo_{density}_p50_ms": round(float(np.median(times_ms)), 3),
            f"stereo_{density}_p99_ms": round(float(np.percentile(times_ms, 99)), 3),
            f"sort_{density}_ms": round(sort_ms, 3),
        }
        cell = f"{min(times_ms):.1f} ({np.median(times_ms):.1f})"
        table.add_row(density, f"{count:,}", cell, f"{sort_ms:.2f}")
    console().print(table)
    renderer = context.renderer
    context.close()
    return renderer, metrics


def _frames_ms(context: "GLContext", scene: "Scene") -> list[float]:
    """What each of FRAMES frames took."""
    from app.xr.link import XrMemory
    from app.xr.loop import XrLoop
    from app.xr.runtimes.standin import StandInRuntime
    from render.types import AHEAD
    from sensors.clock import MonotonicClock
    from sensors.types import FPS, NS

    clock, memory, rng = MonotonicClock(), XrMemory(), np.random.default_rng(0)
    runtime = StandInRuntime(clock, context=context, size=SIZE, hz=0)
    ends_ns: list[int] = []

    def wanted() -> bool:
        """Asked before each frame: a tick comes with every one."""
        now_ns = clock.now_ns()
        memory.ticks.post(
            t_ns=now_ns + NS // FPS,
            posted_ns=now_ns,
            expression=0.3 * rng.normal(size=256),
            gaze=AHEAD,
            head=(0, 0, 0, 1, 0, 0, 0, 0),
        )
        ends_ns.append(time.perf_counter_ns())
        return len(ends_ns) <= FRAMES + WARM_UP

    XrLoop(runtime, memory, lambda _: scene, clock, wanted).run()
    memory.close()
    frames_ns = np.diff(ends_ns[: FRAMES + WARM_UP + 1])  # the loop asks once more at its end
    return (frames_ns[-FRAMES:] / 1e6).tolist()


def _sort_ms(count: int) -> float:
    """The median time to put so many depths in order, which both eyes do for themselves."""
    from render.splats.depth_order import DepthOrder

    rng, order, times_ms = np.random.default_rng(0), DepthOrder(), list[float]()
    for _ in range(SORTS):
        depths = rng.normal(700, 80, count).astype(np.float32)
        start = time.perf_counter()
        order.of(depths)
        times_ms.append(1e3 * (time.perf_counter() - start))
    return float(np.median(times_ms))
