"""A plain WebRTC page in a real browser hears what a call sends, where it is not sealed."""

import asyncio
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest
from browser import chromium, open_page

from app.call.media.connection import Connection, bind_only
from app.call.media.opus import PACKET, OpusEncoder
from app.call.rooms.addresses import own_address
from sensors.types import SAMPLE_RATE

pytestmark = pytest.mark.slow
TONE_HZ = 440.0
ANSWER = """async (offer) => {
  globalThis.pc = new RTCPeerConnection();
  pc.ontrack = ({ track }) => {
    if (globalThis.ear) return;  // the first line is the voice
    const stream = new MediaStream([track]), element = new Audio();
    element.srcObject = stream;
    element.play();
    const context = new AudioContext();
    globalThis.ear = context.createAnalyser();
    ear.fftSize = 8192;
    context.createMediaStreamSource(stream).connect(ear);
    globalThis.element = element;
  };
  await pc.setRemoteDescription({ type: "offer", sdp: offer });
  await pc.setLocalDescription(await pc.createAnswer());
  while (pc.iceGatheringState !== "complete") await new Promise((r) => setTimeout(r, 20));
  return pc.localDescription.sdp;
}"""
HEARD = """() => {
  const levels = new Float32Array(ear.frequencyBinCount);
  ear.getFloatFrequencyData(levels);
  const best = levels.indexOf(Math.max(...levels));
  return [levels[best], best * ear.context.sampleRate / ear.fftSize];
}"""


@contextmanager
def loop_of_its_own() -> Iterator[asyncio.AbstractEventLoop]:
    """The browser's driver takes this thread's."""
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever)
    thread.start()
    yield loop
    loop.call_soon_threadsafe(loop.stop)
    thread.join()
    loop.close()


async def hum(connection: Connection, seconds: float) -> None:
    """A tone, packet by packet, as a call sends its voice."""
    encoder = OpusEncoder()
    for number in range(int(seconds * 100)):
        at = number * PACKET + np.arange(PACKET)
        sound = (0.5 * np.sin(2 * np.pi * TONE_HZ * at / SAMPLE_RATE)).astype(np.float32)
        connection.send("voice", encoder.encode(sound), number * PACKET)
        await asyncio.sleep(0.01)


def test_a_page_hears_the_tone_of_an_unsealed_call() -> None:
    bind_only(own_address())
    with chromium() as browser, loop_of_its_own() as loop:

        def run(work):  # type: ignore[no-untyped-def]
            return asyncio.run_coroutine_threadsafe(work, loop).result(60)

        async def offered() -> tuple[Connection, str]:
            connection = Connection(lambda stream, payload: None)
            return connection, await connection.offer()

        page = open_page(browser, "about:blank", 200, 200)
        connection, offer = run(offered())
        run(connection.accept(page.evaluate(ANSWER, offer)))
        humming = asyncio.run_coroutine_threadsafe(hum(connection, 60), loop)
        page.wait_for_function(
            f"() => {{ const [level, hz] = ({HEARD})(); "
            f"return level > -40 && Math.abs(hz - {TONE_HZ}) < 12; }}",
            timeout=50_000,
        )
        assert page.evaluate("pc.connectionState") == "connected"
        humming.cancel()
        run(connection.close())
        assert page.problems == []
