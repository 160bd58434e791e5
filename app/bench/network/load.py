"""What hostile clients cost: the tick beside a server that they attack, and beside one left alone.

A machine's speed changes within minutes, so the two take turns of SPELL_S. The first second of each
turn counts for neither: clients come and go then.
"""

import subprocess
import sys
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from app.drive.sink import FrameResult, RunInfo
from sensors.types import FPS, LOOPBACK, Clock

if TYPE_CHECKING:
    from app.drive.stages import Stages
    from app.web.sink import WebSink

CLIENTS, ATTACK_S = 50, 60.0  # and as long without them
SPELL_S = 5


def measure_hostile_clients(clock: Clock, avatar: str) -> dict[str, Any]:
    """Tick, memory and CPU time of the server with and without hostile clients."""
    load = _drive(clock, avatar)
    second = load.frames // FPS
    counts, attacked = second % SPELL_S > 0, second // SPELL_S % 2 == 1
    quiet_ms, hostile_ms = (load.ticks_ms[counts & side] for side in (~attacked, attacked))
    quiet_p99, hostile_p99 = (float(np.percentile(ticks, 99)) for ticks in (quiet_ms, hostile_ms))
    seconds = np.arange(len(load.cpu_s) - 1)
    shares, attacks = np.diff(load.cpu_s), seconds // SPELL_S % 2 == 1
    half = len(load.memory_mb) // 2
    growth = max(load.memory_mb[half:]) - max(load.memory_mb[:half])
    return {
        "quiet_tick_p50_ms": round(float(np.median(quiet_ms)), 3),
        "hostile_tick_p50_ms": round(float(np.median(hostile_ms)), 3),
        "quiet_tick_p99_ms": round(quiet_p99, 3),
        "hostile_tick_p99_ms": round(hostile_p99, 3),
        "hostile_tick_p99_change": round(hostile_p99 / quiet_p99 - 1, 3),
        "hostile_memory_growth_mb": round(growth, 2),
        "quiet_server_cpu_share": round(float(shares[~attacks & (seconds > 0)].mean()), 3),
        "hostile_server_cpu_share": round(float(shares[attacks].mean()), 3),
        "hostile_refused": load.refused,
        "hostile_clients_died": int(load.died),
    }


class LoadSink:
    """A sink that starts the hostile clients every other spell, and notes ticks and the server's
    cost."""

    def __init__(self, server: "WebSink", stages: "Stages") -> None:
        self._server, self._stages = server, stages
        self._clients: subprocess.Popen[str] | None = None
        self._frames: list[int] = []  # the newest of each tick
        self._ticks_ms: list[float] = []  # of the tick before each
        self.memory_mb: list[float] = []  # of the server, every second
        self.cpu_s: list[float] = []
        self.refused = 0
        self.died = False

    @property
    def frames(self) -> NDArray[np.int64]:  # [T] the newest frame of each tick
        return np.array(self._frames[:-1])

    @property
    def ticks_ms(self) -> NDArray[np.float64]:  # [T]
        return np.array(self._ticks_ms[1:])

    def on_start(self, info: RunInfo) -> None:
        address = self._server.link.status["addresses"][0]
        words = [
            sys.executable,
            "-m",
            "app.bench.network.hostile_clients",
            address,
            str(CLIENTS),
            str(SPELL_S),
        ]
        self._clients = subprocess.Popen(words, stdin=subprocess.PIPE, text=True)

    def on_frame(self, result: FrameResult) -> None:
        import psutil

        index = result.driven.index
        if result.picture is not None:
            self._frames.append(index)
            self._ticks_ms.append(self._stages.latest_ms()[-1])  # this one has not ended
        if index % FPS == 0:
            process = psutil.Process(self._server.pid)
            self.memory_mb.append(process.memory_info().rss / 2**20)
            used = process.cpu_times()
            self.cpu_s.append(used.user + used.system)
        starts, clients = index % (2 * SPELL_S * FPS) == SPELL_S * FPS, self._clients
        if starts and clients and clients.stdin and clients.poll() is None:
            clients.stdin.write("now\n")
            clients.stdin.flush()

    def close(self) -> None:
        self.refused = self._server.network_report()["page"]["refused"]
        if self._clients:
            self.died = self._clients.poll() is not None
            self._clients.terminate()
            self._clients.wait()


def _drive(clock: Clock, avatar: str) -> LoadSink:
    """The whole tick on silence, with pictures, half of the time with hostile clients."""
    from app.drive.loop import Drive, drive
    from app.drive.stages import Stages
    from app.drive.view import PortraitView
    from app.sinks.progress import ProgressSink
    from app.web.info import ServerInfo
    from app.web.sink import WebSink
    from encoder.inference import load_driver
    from render import cameras
    from render.decoder import identity
    from render.decoder.decoder import Decoder
    from render.splats.renderer import create_renderer
    from sensors.live.source import LiveSource

    server, stages = WebSink(ServerInfo(LOOPBACK, 0, avatar), clock), Stages()
    load = LoadSink(server, stages)
    camera = cameras.portrait(512, 512)
    drive(
        Drive(
            source=LiveSource(None, [], clock, seconds=2 * ATTACK_S),
            driver=load_driver(),
            clock=clock,
            sinks=[server, load, ProgressSink("among hostile clients")],
            view=PortraitView(Decoder.load(), identity.load(avatar), create_renderer(), camera),
            stages=stages,
            info=RunInfo(512, 512, int(2 * ATTACK_S * FPS)),
            realtime=True,
        )
    )
    return load
