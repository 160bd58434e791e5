"""Who the web server lets in, and whom it shows out."""

import asyncio
import errno
import shutil
import socket
import ssl
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import aiohttp
import pytest
from web_client import Talker, expect_the_head_at_once, play, serving, socket_to, wait_until

from app.web import access, certificate, guard
from app.web.guard import RateLimit
from render.decoder.decoder import Decoder
from sensors.types import InputError

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def config(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The user's settings, in which that of the next fixture has put certificate, key and token."""
    return tmp_path_factory.mktemp("config")


@pytest.fixture(scope="module")
def far(decoder: Decoder, config: Path) -> Iterator[Talker]:
    """A server for other machines."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CONFIG_HOME", str(config))
        with serving(decoder, host="0.0.0.0", gaussians="16k") as made:
            yield made


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({"Origin": "https://evil.example"}, 403),
        ({"Origin": "null"}, 403),
        ({"Host": "evil.example"}, 403),  # a name that was made to point here
        ({"Host": "[::1"}, 400),
        ({"Origin": "http://[::1"}, 400),
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


def test_beyond_this_machine_there_is_https_and_a_token(far: Talker, config: Path) -> None:
    address, token = far.address.split("?token=")
    assert address.startswith("https://") and len(token) >= 20
    key = config / "livedrive" / certificate.KEY_FILE
    assert key.stat().st_mode & 0o077 == 0
    trust = ssl.create_default_context(cafile=str(key.with_name(certificate.NAMES_FILE)))
    port = address.rsplit(":", 1)[1]
    local = f"https://127.0.0.1:{port}"

    async def work() -> None:
        jar = aiohttp.CookieJar(unsafe=True)
        async with aiohttp.ClientSession(cookie_jar=jar) as session:
            for path in ("", "main.js", "head", "?token=wrong"):
                refused = await session.get(f"{local}{path}", ssl=trust)
                assert refused.status == 403 and "as livedrive printed" in await refused.text()
            page = await session.get(f"{local}?token={token}", ssl=trust)
            assert page.status == 200
            cookie = page.headers["Set-Cookie"]
            assert "HttpOnly" in cookie and "Secure" in cookie and "SameSite=Strict" in cookie
            assert (await session.get(f"{local}main.js", ssl=trust)).status == 200
            async with session.ws_connect(f"{local}head", ssl=trust, max_msg_size=0) as ws:
                assert (await ws.receive_bytes())[0] == 1

    play(work)


def test_no_other_page_frames_this_one(talker: Talker) -> None:
    """Red without it: a page of another site laid the microphone's button under a click."""

    async def work() -> None:
        async with aiohttp.ClientSession() as session:
            page = await session.get(talker.address)
            assert "frame-ancestors 'none'" in page.headers["Content-Security-Policy"]

    play(work)


def test_a_token_belongs_to_one_port(far: Talker) -> None:
    address, token = far.address.split("?token=")
    port = int(address.rsplit(":", 1)[1].strip("/"))

    async def work() -> None:
        async with aiohttp.ClientSession() as session:
            for cookie, status in (
                (f"livedrive_{port}={token}", 200),
                (f"livedrive_{port + 1}={token}", 403),
                (f"livedrive_{port}=\xff", 403),
                ('a="', 403),
            ):
                got = await session.get(
                    f"https://127.0.0.1:{port}/", ssl=False, headers={"Cookie": cookie}
                )
                assert got.status == status, cookie

    play(work)


def test_a_token_lasts(far: Talker, config: Path, tmp_path: Path) -> None:
    assert access.ensure(config / "livedrive") == far.address.split("?token=")[1]
    first = access.ensure(tmp_path)
    assert access.ensure(tmp_path) == first
    token_file = tmp_path / access.TOKEN_FILE
    assert token_file.stat().st_mode & 0o077 == 0
    for damaged in (b"short", b"\x8a\xff" * 16):  # red before: the second was a traceback
        token_file.write_bytes(damaged)
        with pytest.raises(InputError, match="delete it"):
            access.ensure(tmp_path)


@pytest.mark.usefixtures("far")
def test_a_key_of_another_certificate_is_told(
    decoder: Decoder, config: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Red before: "choose another port"."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    shutil.copytree(config / "livedrive", certificate.folder())
    other = certificate.ensure(tmp_path / "other", ["localhost"], 1.8e9)[1]
    (certificate.folder() / certificate.KEY_FILE).write_bytes(other.read_bytes())
    with pytest.raises(InputError, match="delete both files"), serving(decoder, host="0.0.0.0"):
        pass


def test_a_folder_of_settings_that_cannot_be_used_is_told(
    decoder: Decoder, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Red before: "expected to listen at 0.0.0.0, got: No such file; choose an address"."""
    monkeypatch.setenv("XDG_CONFIG_HOME", "/proc")
    told = pytest.raises(InputError, match="expected to use /proc/livedrive, got: No such")
    with told, serving(decoder, host="0.0.0.0"):
        pass


def test_an_address_of_ipv6_can_be_opened(decoder: Decoder) -> None:
    with serving(decoder, host="::1", gaussians="16k") as talker:
        assert talker.address.startswith("http://[::1]:")

        async def work() -> None:
            async with aiohttp.ClientSession() as session:
                assert (await session.get(talker.address)).status == 200

        play(work)


def test_the_door_opens_again_after_too_many_open_files() -> None:
    """Red before: the first EMFILE ended the task that accepts, and nobody came in any more."""

    class Full:
        calls = 0

        async def sock_accept(self, _: object) -> None:
            self.calls += 1
            if self.calls < 3:
                raise OSError(errno.EMFILE, "Too many open files")
            raise asyncio.CancelledError

        def time(self) -> float:
            return 0.0

    full = Full()

    async def work() -> None:
        with monkey.context() as patch:
            patch.setattr(guard.asyncio, "get_running_loop", lambda: full)
            patch.setattr(guard, "FULL_S", 0.0)
            door = guard.ConnectionLimiter(SimpleNamespace(connections=()), None)  # type: ignore[arg-type]
            with pytest.raises(asyncio.CancelledError):
                await door.work(None)
            assert door.refused == 2

    monkey = pytest.MonkeyPatch()
    asyncio.run(work())


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


@pytest.mark.parametrize("host", ["203.0.113.7", "nobody.invalid"])
def test_an_address_of_another_machine_is_told(decoder: Decoder, host: str) -> None:
    """Red before: "choose another port"."""
    with (
        pytest.raises(InputError, match="choose an address of this machine"),
        serving(decoder, host=host),
    ):
        pass


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
    budget = RateLimit(10, 0.0)
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
    expect_the_head_at_once(talker)
