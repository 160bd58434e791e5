"""A web server to talk to, and what its clients need: ticks that are known, sockets, pictures."""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager, contextmanager
from time import monotonic, sleep

import aiohttp
import numpy as np
from numpy.typing import NDArray

from app.drive.sink import FrameResult, RunInfo
from app.web.cloud import CloudReader
from app.web.info import ServerInfo
from app.web.sink import WebSink
from encoder.types import DrivenFrame
from render import cameras
from render.decoder.decoder import Decoder
from render.decoder.identity import Identity
from render.types import Gaussians, Renderer
from sensors.clock import MonotonicClock
from sensors.types import FPS, NS, SensorFrame

AVATAR = "ben"
PATIENCE_S = 60.0  # the machine may be busy


class Talker:
    """A head that says something else every tick, and its server."""

    def __init__(self, sink: WebSink, decoder: Decoder) -> None:
        self.sink, self.link = sink, sink.link
        self._decoder, self.index = decoder, -1
        self.address: str = sink.link.status["addresses"][0]

    def driven(self, index: int) -> DrivenFrame:
        rig = np.zeros(53, np.float32)
        for name, pace in {
            "jawOpen": 3,
            "mouthSmile_L": 5,
            "eyeBlink_R": 7,
            "browInnerUp_L": 4,
        }.items():
            rig[self._decoder.rig_names.index(name)] = 0.5 - 0.5 * np.cos(index / pace)
        yaw, up = 0.3 * np.sin(index / 9), 0.2 * np.sin(index / 13)
        eye = np.array([np.sin(yaw) * np.cos(up), np.sin(up), np.cos(yaw) * np.cos(up)])
        gaze = np.tile(eye.astype(np.float32), (2, 1))
        return DrivenFrame(index, (index + 1) * NS // FPS, self._decoder.encode(rig), gaze)

    def gaussians(self, index: int, who: Identity) -> Gaussians:
        driven = self.driven(index)
        return self._decoder.decode(driven.expression, driven.gaze, who)[1]

    def tick(self, count: int = 1, pause_s: float = 0.0) -> None:
        for _ in range(count):
            self.index += 1
            driven = self.driven(self.index)
            silence, ages = np.zeros(1600, np.float32), np.full(2, -1, np.int64)
            frame = SensorFrame(
                driven.index, driven.t_ns, silence, None, np.zeros(2, bool), ages, False
            )
            self.sink.on_frame(FrameResult(frame, driven, None))
            sleep(pause_s)

    def count(self, name: str) -> int:
        self.link.read()
        return self.link.status.get(name, 0)


@contextmanager
def serving(decoder: Decoder, **options: object) -> Iterator[Talker]:
    fields: dict[str, object] = {"host": "127.0.0.1", "port": 0, "avatar": AVATAR}
    sink = WebSink(ServerInfo(**(fields | options)), MonotonicClock())  # type: ignore[arg-type]
    try:
        sink.on_start(RunInfo(64, 64, None))
        yield Talker(sink, decoder)
    finally:
        sink.close()


def wait_until(what, patience_s: float = PATIENCE_S) -> None:  # noqa: ANN001
    end = monotonic() + patience_s
    while not what():
        assert monotonic() < end, "waited in vain"
        sleep(0.02)


def psnr(one: NDArray[np.uint8], other: NDArray[np.uint8]) -> float:
    """Of two pictures of equal size, in dB."""
    error = np.mean((one[..., :3].astype(float) - other[..., :3].astype(float)) ** 2)
    return float(10 * np.log10(255**2 / max(error, 1e-12)))


@asynccontextmanager
async def socket_to(
    talker: Talker, path: str, **options: object
) -> AsyncIterator[aiohttp.ClientWebSocketResponse]:
    async with (
        aiohttp.ClientSession() as session,
        session.ws_connect(talker.address.split("?")[0] + path, **options) as ws,  # type: ignore[arg-type]
    ):
        yield ws


def play(work: Callable[[], Awaitable[None]]) -> None:
    """Here, where tests draw; in a thread where a browser of the module holds the loop of this."""

    async def limited() -> None:
        async with asyncio.timeout(PATIENCE_S):
            await work()

    try:
        asyncio.get_running_loop()
    except RuntimeError:
        asyncio.run(limited())
    else:
        with ThreadPoolExecutor(1) as thread:
            thread.submit(lambda: asyncio.run(limited())).result()


def draw(renderer: Renderer, gaussians: Gaussians, size: int = 256) -> np.ndarray:
    renderer.draw(gaussians, cameras.portrait(size, size))
    return renderer.read_rgba().copy()


def expect_the_head_at_once(talker: Talker) -> None:
    """A page that comes now."""
    talker.tick()

    async def work() -> None:
        async with socket_to(talker, "head", max_msg_size=0) as ws:
            reader = CloudReader()
            for _ in range(2):
                reader.read(await ws.receive_bytes())
            assert reader.frame == talker.index

    play(work)
