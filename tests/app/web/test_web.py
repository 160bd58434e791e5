"""The web server as a client meets it: what it streams, its files, its socket to the loop."""

import asyncio
import json
from pathlib import Path

import aiohttp
import numpy as np
import pytest
from web_client import (
    Talker,
    draw,
    expect_the_head_at_once,
    play,
    psnr,
    serving,
    socket_to,
    wait_until,
)

from app.face.arkit import ARKIT_NAMES
from app.process.channel import pair
from app.sinks.protocols.face import FaceReader
from app.web.cloud import CloudReader
from app.web.link import ServerLink, pack_tick, unpack_tick
from render.decoder.decoder import Decoder
from render.decoder.identity import Identity
from render.types import Renderer

pytestmark = pytest.mark.slow

PAGE = Path(__file__).parents[3] / "app" / "web" / "page"


# The streams


def test_the_stream_shows_what_the_loop_drove(
    talker: Talker, who: Identity, renderer: Renderer
) -> None:
    async def work() -> None:
        async with socket_to(talker, "head", max_msg_size=0) as ws:
            reader = CloudReader()
            reader.read(await ws.receive_bytes())
            talker.tick()
            while reader.frame != talker.index:
                reader.read(await ws.receive_bytes())
            assert reader.gaussians is not None
            expected = draw(renderer, talker.gaussians(talker.index, who))
            assert psnr(draw(renderer, reader.gaussians), expected) >= 45

    play(work)


def test_programs_get_every_tick_by_name(talker: Talker, decoder: Decoder) -> None:
    async def work() -> None:
        async with socket_to(talker, "json") as ws:
            first = asyncio.ensure_future(ws.receive_json())
            while not first.done():  # it is let in
                talker.tick()
                await asyncio.sleep(0.02)
            frame = (await first)["frame"]
            while frame != talker.index:
                frame = (await ws.receive_json())["frame"]
            start = talker.index + 1
            for index in range(start, start + 30):
                talker.tick()
                message = {"frame": -1}
                while message["frame"] != index:
                    message = await ws.receive_json()
                    assert message["frame"] >= index - 1
                face = FaceReader(decoder)(talker.driven(index))
                assert list(message["arkit"]) == list(ARKIT_NAMES)
                assert list(message["arkit"].values()) == pytest.approx(face.arkit, abs=1e-5)
                for eye, side in enumerate(("left", "right")):
                    got = message["eyes"][side]
                    assert [got["yaw"], got["pitch"]] == pytest.approx(face.angles[eye], abs=1e-5)

    play(work)


def test_a_json_target_serves_programs_and_no_page_and_tells_them_that_it_is_over(
    decoder: Decoder,
) -> None:
    """Red before: 1006, as after a crash."""

    async def work() -> None:
        with serving(decoder, page=False) as talker:
            assert talker.address.startswith("ws://127.0.0.1:")
            async with aiohttp.ClientSession() as session:
                for path in ("main.js", "head", "json"):
                    url = talker.address.replace("ws", "http", 1) + path
                    assert (await session.get(url)).status == 404
            async with socket_to(talker, "") as ws:
                talker.tick()
                assert (await ws.receive_json())["frame"] == talker.index
                talker.link.finish()
                told = await ws.receive()
                while told.type is aiohttp.WSMsgType.TEXT:
                    told = await ws.receive()
                assert told.data == aiohttp.WSCloseCode.GOING_AWAY

    play(work)


def test_a_late_page_gets_the_head_at_once(talker: Talker) -> None:
    expect_the_head_at_once(talker)


def test_a_page_that_stalls_misses_ticks_and_then_sees_the_newest(talker: Talker) -> None:
    async def work() -> None:
        reader, seen = CloudReader(), []
        async with socket_to(talker, "head", max_msg_size=0) as ws:
            reader.read(await ws.receive_bytes())
            transport = ws._response.connection.transport  # type: ignore[union-attr]  # noqa: SLF001
            before = talker.count("skipped")
            transport.pause_reading()

            def is_skipped() -> bool:
                talker.tick()
                return talker.count("skipped") >= before + 3

            await asyncio.to_thread(wait_until, is_skipped)
            transport.resume_reading()
            while reader.frame != talker.index:
                reader.read(await ws.receive_bytes())
                seen.append(reader.frame)
        assert seen == sorted(seen) and len(seen) <= talker.index

    play(work)


# The page's files


def test_the_page_names_no_address_outside() -> None:
    for path in PAGE.iterdir():
        text = path.read_text().replace("http://www.w3.org/2000/svg", "")
        assert "http://" not in text and "https://" not in text and "import(" not in text, path


def test_the_page_is_whole_and_may_talk_to_its_server_only(talker: Talker) -> None:
    async def work() -> None:
        async with aiohttp.ClientSession() as session:
            for path in PAGE.iterdir():
                reply = await session.get(talker.address + path.name)
                assert reply.status == 200 and await reply.read() == path.read_bytes()
            reply = await session.get(talker.address)
            assert "<canvas" in await reply.text()
            assert reply.headers["Content-Security-Policy"].startswith("default-src 'self';")
            for wrong in ("../server.py", "%2e%2e/server.py", "..%2fserver.py", "x"):
                assert (await session.get(f"{talker.address}{wrong}")).status == 404

    play(work)


# The socket between the loop and the server


def test_a_tick_crosses_the_socket_unchanged(talker: Talker) -> None:
    sent = talker.driven(17)
    got = unpack_tick(pack_tick(sent))
    assert (got.index, got.t_ns) == (sent.index, sent.t_ns)
    np.testing.assert_array_equal(got.expression, sent.expression)
    np.testing.assert_array_equal(got.gaze, sent.gaze)


def test_a_server_that_hangs_costs_ticks_and_no_time(talker: Talker) -> None:
    ours, theirs = pair()
    link = ServerLink(ours)
    for k in range(20_000):  # nobody reads at the other end
        link.post(talker.driven(k) if k < 2 else talker.driven(2))
        if link.dropped > 100:
            break
    assert link.dropped > 100 and not link.ended
    theirs.close()
    link.read()
    assert link.ended
    link.close()


def test_status_is_text(talker: Talker) -> None:
    talker.tick()
    wait_until(lambda: talker.count("ticks") > 0)
    assert json.dumps(talker.sink.network_report())
