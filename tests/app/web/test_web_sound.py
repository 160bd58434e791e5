"""The page's microphone as the loop hears it."""

import asyncio
import struct

import aiohttp
import numpy as np
import pytest
from web_client import Talker, play, serving, socket_to, wait_until

from app.web.microphone import WebMicrophone
from render.decoder.decoder import Decoder
from sensors.clock import MonotonicClock
from sensors.types import NS, SAMPLE_RATE, AudioPacket

pytestmark = pytest.mark.slow


def chunk(first: int, samples: np.ndarray) -> bytes:
    return struct.pack("<q", first) + samples.astype("<f4").tobytes()


def test_sound_of_the_page_arrives_whole_and_its_losses_are_counted(talker: Talker) -> None:
    microphone = WebMicrophone(talker.link, MonotonicClock())
    with pytest.raises(RuntimeError):
        microphone.poll()
    microphone.open()
    sound = np.random.default_rng(1).uniform(-1, 1, 40 * 480).astype(np.float32)
    waiting = talker.link.sounds

    def all_there() -> bool:
        talker.link.read()
        return len(waiting) == 38

    async def work() -> None:
        async with socket_to(talker, "microphone") as ws:
            for k in range(40):
                if k not in (20, 21):  # two chunks that the page had to leave out
                    await ws.send_bytes(chunk(1000 + 480 * k, sound[480 * k : 480 * k + 480]))
            await asyncio.to_thread(wait_until, all_there)

    play(work)
    arrivals_ns = [arrival_ns for _, _, arrival_ns, _ in waiting]
    assert arrivals_ns[0] > 0 and arrivals_ns == sorted(arrivals_ns)
    # A page sends a chunk when it is full. One that a busy machine lets wait for a second is told
    # as a loss, which is the matter of test_clock_map.py.
    even = [
        (page, first, arrivals_ns[0] + (first - 1000) * NS // SAMPLE_RATE, samples)
        for page, first, _, samples in waiting
    ]
    waiting.clear()
    waiting.extend(even)
    packets = [p for p in microphone.poll() if isinstance(p, AudioPacket)]
    assert microphone.problem == "" and (microphone.losses, microphone.dropped) == (1, 960)
    heard = np.zeros(40 * 480, np.float32)
    for packet in packets:
        heard[packet.first_sample : packet.first_sample + len(packet.samples)] = packet.samples
    sound[20 * 480 : 22 * 480] = 0
    np.testing.assert_array_equal(heard, sound)
    assert [p.gap for p in packets] == [k in (0, 20) for k in range(38)]
    assert all(b.t_ns > a.t_ns for a, b in zip(packets, packets[1:], strict=False))
    microphone.close()
    microphone.close()


def test_a_second_page_goes_on_counting(talker: Talker) -> None:
    microphone = WebMicrophone(talker.link, MonotonicClock())
    microphone.open()
    packets: list[AudioPacket] = []

    async def is_heard(page: int) -> bool:
        """False where the server has not yet seen the page before leave."""
        async with socket_to(talker, "microphone") as ws:
            await ws.send_bytes(chunk(77, np.full(480, 0.1 + page, np.float32)))
            refused = asyncio.ensure_future(ws.receive())

            def arrived() -> bool:
                packets.extend(p for p in microphone.poll() if isinstance(p, AudioPacket))
                return len(packets) == page + 1

            await asyncio.to_thread(wait_until, lambda: arrived() or refused.done())
            refused.cancel()
            return arrived()

    async def work() -> None:
        for page in range(2):
            while not await is_heard(page):
                pass

    play(work)
    assert [p.first_sample for p in packets] == [0, 480]
    assert microphone.reopened == 1 and microphone.dropped == 0


NOT_SOUND = {
    "empty": b"",
    "a text": "sound",
    "half a sample": struct.pack("<q", 0) + b"\0" * 7,
    "no samples": struct.pack("<q", 0),
    "not a number": chunk(0, np.full(480, np.nan)),
    "a negative counter": chunk(-1, np.zeros(480)),
    "an endless counter": chunk(1 << 60, np.zeros(480)),
    "too long": chunk(0, np.zeros(5000)),
}


@pytest.mark.parametrize("what", NOT_SOUND)
def test_what_is_not_sound_is_refused(talker: Talker, what: str) -> None:
    def refused() -> int:
        return (talker.count("microphone") or {"refused": 0})["refused"]  # type: ignore[index]

    before = refused()

    async def work() -> None:
        data = NOT_SOUND[what]
        async with socket_to(talker, "microphone") as ws:
            await (ws.send_str(data) if isinstance(data, str) else ws.send_bytes(data))
            assert (await ws.receive()).type in (aiohttp.WSMsgType.CLOSE, aiohttp.WSMsgType.CLOSED)

    play(work)
    wait_until(lambda: refused() == before + 1)


def test_one_page_at_a_time_may_speak(talker: Talker) -> None:
    async def work() -> None:
        async with socket_to(talker, "microphone"), socket_to(talker, "microphone") as second:
            refused = await second.receive()
            assert refused.type == aiohttp.WSMsgType.CLOSE
            assert refused.extra == "another page has the microphone"  # what the page then says
        await asyncio.sleep(0.3)

    play(work)


def test_a_run_without_it_offers_no_microphone_and_outlives_its_server(decoder: Decoder) -> None:
    with serving(decoder) as talker:

        async def work() -> None:
            async with aiohttp.ClientSession() as session:
                offers = await session.get(f"{talker.address}offers")
                told = await offers.json()
                assert not told["microphone"] and not told["head"]
                assert (await session.get(f"{talker.address}microphone")).status == 404

        play(work)
        talker.sink._process.kill()  # noqa: SLF001
        talker.sink._process.wait()  # noqa: SLF001
        talker.tick(5)
        assert talker.link.ended
