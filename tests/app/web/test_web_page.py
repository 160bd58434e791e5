"""The page in headless Chromium: its picture against ours, two eyes in a headset."""

import asyncio
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AsyncExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser import SPY, headset, open_page, screenshot
from web_client import Talker, psnr, serving, socket_to, wait_until

from app.web.hub import MAX_LISTENERS
from render import cameras
from render.cameras import DEFAULT_BACKGROUND
from render.decoder.decoder import Decoder
from render.decoder.identity import Identity
from render.types import Camera, Renderer

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[3]
SIZE = 256


def settle(page: Any, talker: Talker) -> None:
    """Wait until the newest tick is on the screen, sorted for the present view."""

    def seen() -> bool:
        frame, draws, waiting = page.evaluate(
            "[livedrive.frame, livedrive.draws, livedrive.asked - livedrive.sorted]"
        )
        still = (frame, draws, waiting) == (talker.index, page.settled, 0)
        page.settled = draws
        page.wait_for_timeout(300)
        return still

    page.settled = -1
    wait_until(seen)


@contextmanager
def crowd(talker: Talker) -> Iterator[None]:
    """As many listeners as the server takes."""
    here, leave = threading.Event(), threading.Event()

    async def stay() -> None:
        async with AsyncExitStack() as stack:
            for _ in range(MAX_LISTENERS):
                await stack.enter_async_context(socket_to(talker, "head", max_msg_size=0))
            here.set()
            while not leave.is_set():
                await asyncio.sleep(0.05)

    with ThreadPoolExecutor(1) as thread:
        staying = thread.submit(asyncio.run, stay())
        try:
            wait_until(lambda: here.is_set() or staying.done())
            yield
        finally:
            leave.set()
            staying.result()


def test_a_page_without_controls_tells_why_it_shows_nothing(browser: Any, decoder: Decoder) -> None:
    """Red before: it stayed empty without a word."""
    with serving(decoder) as talker:
        with crowd(talker):
            page = open_page(browser, f"{talker.address}?bare", SIZE, SIZE)
            page.wait_for_selector("text=Too many listeners.")
        talker.tick()
        wait_until(lambda: page.evaluate("livedrive.frame") == talker.index)
        page.wait_for_timeout(1500)  # no count of frames
        assert page.inner_text("#state") == "" and page.is_hidden("nav")
    page.wait_for_selector("text=waiting for livedrive")
    page.close()


def test_the_picture_is_that_of_the_local_renderer(
    browser: Any, talker: Talker, who: Identity, renderer: Renderer
) -> None:
    page = open_page(browser, f"{talker.address}?bare", SIZE, SIZE)
    talker.tick(5)
    settle(page, talker)
    shown = screenshot(page)
    renderer.draw(talker.gaussians(talker.index, who), cameras.portrait(SIZE, SIZE))
    expected = renderer.read_rgba()[..., :3].copy()
    assert psnr(shown, expected) >= 45
    page.evaluate("document.getElementById('mode').click()")  # mirror
    wait_until(lambda: psnr(screenshot(page)[:, ::-1], expected) >= 45)
    assert psnr(screenshot(page), expected) < 30  # the face is not symmetric
    assert page.problems == []
    page.close()


def test_a_hand_turns_and_a_wheel_enlarges_the_head(
    browser: Any, talker: Talker, who: Identity, renderer: Renderer
) -> None:
    page = open_page(browser, f"{talker.address}?bare", SIZE, SIZE)
    settle(page, talker)
    # older phones lack it; red before: the head was gone for good
    page.evaluate("Object.defineProperty(MouseEvent.prototype, 'movementX', { value: undefined })")
    page.mouse.move(100, 100)
    page.mouse.down()
    page.mouse.move(50, 120, steps=5)
    page.mouse.up()
    page.mouse.wheel(0, -200)
    settle(page, talker)
    yaw, pitch = np.degrees([50 * 0.006, 20 * 0.006])
    camera = cameras.Orbit(yaw_deg=yaw, pitch_deg=pitch, zoom=float(np.exp(0.2)))
    renderer.draw(talker.gaussians(talker.index, who), camera.camera(SIZE, SIZE))
    assert psnr(screenshot(page), renderer.read_rgba()) >= 45
    assert page.problems == []
    page.close()


def test_a_context_that_is_taken_away_comes_back(browser: Any, talker: Talker) -> None:
    """As phones do while a page is not seen. Red before: it stayed black."""
    page = open_page(browser, f"{talker.address}?bare", SIZE, SIZE)
    settle(page, talker)
    with page.expect_navigation():
        page.evaluate(
            "const gl = document.getElementById('view').getContext('webgl2');"
            "const extension = gl.getExtension('WEBGL_lose_context');"
            "extension.loseContext();"
            "setTimeout(() => extension.restoreContext(), 100)"
        )
    wait_until(lambda: page.evaluate("Boolean(globalThis.livedrive)"))
    settle(page, talker)
    assert screenshot(page).std() > 10
    page.close()


def test_a_headset_sees_the_head_with_both_eyes(
    browser: Any, talker: Talker, who: Identity, renderer: Renderer
) -> None:
    page = open_page(browser, f"{talker.address}?bare", 2 * SIZE, SIZE, SPY, headset(ROOT))
    settle(page, talker)
    page.evaluate("document.getElementById('vr').click()")
    wait_until(lambda: page.evaluate("Boolean(device.activeSession)"))
    drawn = page.evaluate("livedrive.draws") + 8  # four frames of both eyes
    wait_until(lambda: page.evaluate("livedrive.draws") >= drawn)
    told = page.evaluate("matrices")
    expected: list[np.ndarray] = []
    for eye in range(2):
        model_view, projection = (
            np.array(told[name][eye]).reshape(4, 4).T for name in ("modelView", "projection")
        )
        renderer.draw(
            talker.gaussians(talker.index, who), camera_of(model_view, projection, SIZE, SIZE)
        )
        expected.append(renderer.read_rgba().copy())

    def eyes_shown() -> list[np.ndarray]:
        return np.split(screenshot(page), 2, axis=1)

    wait_until(lambda: all(map(lambda a, b: psnr(a, b) >= 45, eyes_shown(), expected)))
    eyes = eyes_shown()
    assert psnr(eyes[0], eyes[1]) < 30  # two eyes, two pictures
    across = [np.average(np.arange(SIZE), weights=skin(picture).sum(0)) for picture in eyes]
    assert across[0] > across[1] + 2  # what is near lies further right for the left eye
    assert page.problems == []
    page.close()


def skin(picture: np.ndarray) -> np.ndarray:
    return picture[..., 0].astype(float) - picture[..., 2] > 30


def camera_of(model_view: np.ndarray, projection: np.ndarray, width: int, height: int) -> Camera:
    """Our camera of WebGL's matrices; the model is in metres there."""
    flip = np.diag([1.0, -1.0, -1.0, 1.0])
    view = flip @ model_view * 1000
    view[3] = (0, 0, 0, 1)
    K = np.array(
        [
            [projection[0, 0] * width / 2, 0, (1 - projection[0, 2]) * width / 2],
            [0, projection[1, 1] * height / 2, (1 + projection[1, 2]) * height / 2],
            [0, 0, 1],
        ]
    )
    return Camera(view, K, width, height, 100.0, DEFAULT_BACKGROUND)
