"""The web server as a client meets it: what it streams, whom it refuses, that nobody slows it."""

import asyncio
import json
import socket
import ssl
import struct
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import asynccontextmanager
from pathlib import Path

import aiohttp
import numpy as np
import pytest
from web_client import AVATAR, PATIENCE_S, Talker, psnr, serving, wait_until

from app.sinks.arkit import ARKIT_NAMES
from app.sinks.face import FaceReader
from app.web import certificate
from app.web.cloud import CloudReader, Ranges, base_message, pack, tick_message
from app.web.guard import Budget
from app.web.link import Link, pack_tick, pair, unpack_tick
from app.web.microphone import WebMicrophone
from render import cameras, identity
from render.decoder import Decoder
from render.identity import Identity
from render.renderer import create_renderer
from render.types import Gaussians, Renderer
from sensors.types import AudioPacket, InputError

PAGE = Path(__file__).parents[2] / "app" / "web" / "page"


@pytest.fixture(scope="module")
def decoder() -> Decoder:
    return Decoder.load()


@pytest.fixture(scope="module")
def who() -> Identity:
    return identity.load(AVATAR)


@pytest.fixture(scope="module")
def renderer() -> Iterator[Renderer]:
    made = create_renderer()
    yield made
    made.close()


@pytest.fixture(scope="module")
def talker(decoder: Decoder) -> Iterator[Talker]:
    with serving(decoder, microphone=True) as made:
        yield made


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
    async def limited() -> None:
        async with asyncio.timeout(PATIENCE_S):
            await work()

    asyncio.run(limited())


# The bytes of the cloud


def test_a_cloud_survives_the_network(decoder: Decoder, who: Identity, renderer: Renderer) -> None:
    rest = decoder.decode(np.zeros(256, np.float32), AHEAD, who)[1]
    rig = np.zeros(53, np.float32)
    rig[decoder.rig_names.index("jawOpen")] = 0.8
    now = decoder.decode(decoder.encode(rig), AHEAD, who)[1]
    ranges, reader = Ranges.around(rest), CloudReader()
    base = base_message(rest, ranges)
    tick = tick_message(pack(now, ranges), pack(rest, ranges), 7, 11)
    assert len(base) <= 16 * len(rest) + 64
    reader.read(base)
    reader.read(tick)
    got = reader.gaussians
    assert got is not None and (reader.frame, reader.t_ns) == (7, 11)
    np.testing.assert_allclose(got.means, now.means, atol=ranges.step_mm)
    np.testing.assert_allclose(np.log2(got.scales), np.log2(now.scales), atol=ranges.step_scale)
    np.testing.assert_allclose(got.colors, now.colors, atol=1 / 255)
    assert len(tick) < len(base)
    still = tick_message(pack(rest, ranges), pack(rest, ranges), 8, 12)
    assert len(still) <= len(rest) / 8 + 64  # what rests is not sent
    picture = draw(renderer, now)
    assert psnr(draw(renderer, got), picture) > 50
    assert psnr(draw(renderer, rest), picture) < 40  # the jaw did move


AHEAD = np.tile(np.array([0, 0, 1], np.float32), (2, 1))


def draw(renderer: Renderer, gaussians: Gaussians, size: int = 256) -> np.ndarray:
    renderer.draw(gaussians, cameras.portrait(size, size))
    return renderer.read_rgba().copy()


def test_every_turn_survives_the_network() -> None:
    rng = np.random.default_rng(0)
    quats = rng.standard_normal((5000, 4)).astype(np.float32)
    quats[:6] = [
        [1, 0, 0, 0],
        [-1, 0, 0, 0],
        [0, 1, 0, 0],
        [0, 0, -1, 0],
        [0, 0, 0, 1],
        [-0.0, 1, 0, 0],
    ]
    n = len(quats)
    cloud = Gaussians(
        means=rng.uniform(-100, 100, (n, 3)).astype(np.float32),
        quats=quats,
        scales=rng.uniform(0.1, 5, (n, 3)).astype(np.float32),
        opacities=np.ones(n, np.float32),
        colors=np.ones((n, 3), np.float32),
    )
    reader = CloudReader()
    reader.read(base_message(cloud, Ranges.around(cloud)))
    assert reader.gaussians is not None
    unit = quats / np.linalg.norm(quats, axis=1, keepdims=True)
    cosine = np.abs((unit * reader.gaussians.quats).sum(1)).clip(0, 1)
    assert np.degrees(2 * np.arccos(cosine.astype(np.float64))).max() < 0.5


def test_a_tick_needs_no_other_tick(decoder: Decoder, who: Identity) -> None:
    """Newest wins: a client that missed ticks decodes the next one to the same cloud."""
    rest = decoder.decode(np.zeros(256, np.float32), AHEAD, who)[1]
    ranges = Ranges.around(rest)
    base, words = base_message(rest, ranges), pack(rest, ranges)
    ticks = []
    for k in range(3):
        rig = np.zeros(53, np.float32)
        rig[5 * k : 5 * k + 5] = 0.7
        now = decoder.decode(decoder.encode(rig), AHEAD, who)[1]
        ticks.append(tick_message(pack(now, ranges), words, k, k))
    all_of_them, last = CloudReader(), CloudReader()
    for message in (base, *ticks):
        all_of_them.read(message)
    for message in (base, ticks[-1]):
        last.read(message)
    assert all_of_them.gaussians is not None and last.gaussians is not None
    np.testing.assert_array_equal(all_of_them.gaussians.means, last.gaussians.means)


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
            await asyncio.sleep(0.3)
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


def test_a_json_target_serves_programs_and_no_page(decoder: Decoder) -> None:
    with serving(decoder, page=False) as talker:
        assert talker.address.startswith("ws://127.0.0.1:")

        async def work() -> None:
            async with socket_to(talker, "") as ws:
                talker.tick()
                assert (await ws.receive_json())["frame"] == talker.index
            async with aiohttp.ClientSession() as session:
                for path in ("main.js", "head", "json"):
                    url = talker.address.replace("ws", "http", 1) + path
                    assert (await session.get(url)).status == 404

        play(work)


def test_a_late_page_gets_the_head_at_once(talker: Talker) -> None:
    talker.tick()

    async def work() -> None:
        async with socket_to(talker, "head", max_msg_size=0) as ws:
            reader = CloudReader()
            for _ in range(2):
                reader.read(await ws.receive_bytes())
            assert reader.frame == talker.index

    play(work)


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


# Who is let in


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({"Origin": "https://evil.example"}, 403),
        ({"Origin": "null"}, 403),
        ({"Host": "evil.example"}, 403),  # a name that was made to point here
        ({"Host": "localhost:8443"}, 101),  # adb reverse
        ({"Host": "localhost:8443", "Origin": "http://localhost:8443"}, 101),
        ({}, 101),
    ],
)
def test_other_sites_are_refused(talker: Talker, headers: dict[str, str], status: int) -> None:
    async def work() -> None:
        try:
            async with socket_to(talker, "head", headers=headers, max_msg_size=0):
                assert status == 101
        except aiohttp.WSServerHandshakeError as error:
            assert error.status == status

    play(work)


def test_beyond_this_machine_there_is_https_and_a_token(
    decoder: Decoder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    with serving(decoder, host="0.0.0.0") as talker:
        address, token = talker.address.split("?token=")
        assert address.startswith("https://") and len(token) >= 20
        key = tmp_path / "livedrive" / certificate.KEY_FILE
        assert key.stat().st_mode & 0o077 == 0
        trust = ssl.create_default_context(cafile=str(key.with_name(certificate.NAMES_FILE)))
        port = address.rsplit(":", 1)[1]
        local = f"https://127.0.0.1:{port}"

        async def work() -> None:
            jar = aiohttp.CookieJar(unsafe=True)
            async with aiohttp.ClientSession(cookie_jar=jar) as session:
                for path in ("", "main.js", "head", "?token=wrong"):
                    assert (await session.get(f"{local}{path}", ssl=trust)).status == 403
                page = await session.get(f"{local}?token={token}", ssl=trust)
                assert page.status == 200
                cookie = page.headers["Set-Cookie"]
                assert "HttpOnly" in cookie and "Secure" in cookie and "SameSite=Strict" in cookie
                assert (await session.get(f"{local}main.js", ssl=trust)).status == 200
                async with session.ws_connect(f"{local}head", ssl=trust, max_msg_size=0) as ws:
                    assert (await ws.receive_bytes())[0] == 1

        play(work)


def test_a_certificate_is_kept_until_it_is_too_old(tmp_path: Path) -> None:
    names, _ = certificate.ensure(tmp_path, ["localhost"], 1.8e9)
    first = names.read_bytes()
    certificate.ensure(tmp_path, ["localhost"], 1.8e9 + 300 * 86400)
    assert names.read_bytes() == first
    certificate.ensure(tmp_path, ["localhost"], 1.8e9 + 400 * 86400)
    second = names.read_bytes()
    assert second != first
    certificate.ensure(tmp_path, ["localhost", "10.0.0.7"], 1.8e9 + 400 * 86400)
    assert names.read_bytes() != second


def test_a_port_in_use_is_one_line(decoder: Decoder) -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        with (
            pytest.raises(InputError, match="in use; choose another port"),
            serving(decoder, port=other.getsockname()[1]),
        ):
            pass


def test_a_budget_allows_bursts_and_no_flood() -> None:
    budget = Budget(10, 0.0)
    assert [budget.spend(0.0) for _ in range(12)] == [True] * 10 + [False] * 2
    assert [budget.spend(1.0) for _ in range(3)] == [True] * 3


@pytest.mark.parametrize("path", ["head", "json"])
def test_a_listener_that_floods_is_shown_out(talker: Talker, path: str) -> None:
    async def work() -> None:
        async with socket_to(talker, path, max_msg_size=0) as ws:
            with pytest.raises(ConnectionError):
                for _ in range(100_000):
                    await ws.send_str("x" * 100)
                    await asyncio.sleep(0)
            while not ws.closed:
                await ws.receive()

    play(work)
    wait_until(lambda: talker.count("pages") == 0 and talker.count("programs") == 0)


def test_garbage_and_half_a_request_end_alone(talker: Talker) -> None:
    host, port = talker.address.split("/")[2].split(":")
    for data in (b"\x16\x03\x01\xff" * 500, b"GET /head HTTP/1.1\r\nHo", b"A" * 100_000):
        with socket.create_connection((host, int(port)), 20) as end:
            end.settimeout(20)
            try:
                end.sendall(data)
                while end.recv(1000):
                    pass
            except ConnectionError:
                pass
    test_a_late_page_gets_the_head_at_once(talker)


# The page's microphone


def chunk(first: int, samples: np.ndarray) -> bytes:
    return struct.pack("<q", first) + samples.astype("<f4").tobytes()


def test_sound_of_the_page_arrives_whole_and_its_losses_are_counted(talker: Talker) -> None:
    microphone = WebMicrophone(talker.link)
    with pytest.raises(RuntimeError):
        microphone.poll()
    microphone.open()
    sound = np.random.default_rng(1).uniform(-1, 1, 48 * 480).astype(np.float32)
    packets: list[AudioPacket] = []

    def collect(samples: int) -> None:
        def done() -> bool:
            packets.extend(p for p in microphone.poll() if isinstance(p, AudioPacket))
            return sum(len(p.samples) for p in packets) >= samples

        wait_until(done)

    async def work() -> None:
        async with socket_to(talker, "microphone") as ws:
            start = asyncio.get_running_loop().time()
            for k in range(40):
                if k not in (20, 21):  # two chunks that the page had to leave out
                    await ws.send_bytes(chunk(1000 + 480 * k, sound[480 * k : 480 * k + 480]))
                await asyncio.sleep(start + 0.01 * (k + 1) - asyncio.get_running_loop().time())
            await asyncio.to_thread(collect, 38 * 480)

    play(work)
    assert microphone.problem == "" and (microphone.losses, microphone.dropped) == (1, 960)
    heard = np.zeros(40 * 480, np.float32)
    for packet in packets:
        heard[packet.first_sample : packet.first_sample + len(packet.samples)] = packet.samples
    sound[20 * 480 : 22 * 480] = 0
    np.testing.assert_array_equal(heard, sound[: len(heard)])
    assert [p.gap for p in packets] == [k in (0, 20) for k in range(38)]
    assert all(b.t_ns > a.t_ns for a, b in zip(packets, packets[1:], strict=False))
    microphone.close()
    microphone.close()


def test_a_second_page_goes_on_counting(talker: Talker) -> None:
    microphone = WebMicrophone(talker.link)
    microphone.open()
    packets: list[AudioPacket] = []

    async def work() -> None:
        for page in range(2):
            async with socket_to(talker, "microphone") as ws:
                await ws.send_bytes(chunk(77, np.full(480, 0.1 + page, np.float32)))

                def arrived(page: int = page) -> bool:
                    packets.extend(p for p in microphone.poll() if isinstance(p, AudioPacket))
                    return len(packets) == page + 1

                await asyncio.to_thread(wait_until, arrived)
            await asyncio.sleep(0.3)

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
        async with socket_to(talker, "microphone"):
            with pytest.raises(aiohttp.WSServerHandshakeError) as refused:
                async with socket_to(talker, "microphone"):
                    pass
            assert refused.value.status == 409
        await asyncio.sleep(0.3)

    play(work)


def test_a_run_without_it_offers_no_microphone_and_outlives_its_server(decoder: Decoder) -> None:
    with serving(decoder) as talker:

        async def work() -> None:
            async with aiohttp.ClientSession() as session:
                offers = await session.get(f"{talker.address}offers")
                assert await offers.json() == {"microphone": False}
                assert (await session.get(f"{talker.address}microphone")).status == 404

        play(work)
        talker.sink._process.kill()  # noqa: SLF001
        talker.sink._process.wait()  # noqa: SLF001
        talker.tick(5)
        assert talker.link.ended


# The socket between the loop and the server


def test_a_tick_crosses_the_socket_unchanged(talker: Talker) -> None:
    sent = talker.driven(17)
    got = unpack_tick(pack_tick(sent))
    assert (got.index, got.t_ns) == (sent.index, sent.t_ns)
    np.testing.assert_array_equal(got.expression, sent.expression)
    np.testing.assert_array_equal(got.gaze, sent.gaze)


def test_a_server_that_hangs_costs_ticks_and_no_time(talker: Talker) -> None:
    ours, theirs = pair()
    link = Link(ours)
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
    wait_until(lambda: talker.count("ticks") > 0)
    assert json.dumps(talker.sink.report())
