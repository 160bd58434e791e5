"""The page and the head's pose: a headset's arrives in the driven frame, a turned head is drawn."""

from collections.abc import Iterator
from math import radians
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser import headset, open_page, screenshot
from web_client import Talker, psnr, serving, wait_until

from app.drive.sink import FrameResult
from app.web.headset_source import web_head
from encoder.alive.alive import Alive
from encoder.alive.face import Shapes
from encoder.types import DrivenFrame
from render import cameras
from render.decoder.decoder import Decoder
from render.decoder.identity import Identity
from render.types import AHEAD, Renderer
from sensors import rotation
from sensors.assemble import Assembler
from sensors.clock import MonotonicClock
from sensors.types import AudioPacket, HeadPose, SensorFrame

pytestmark = pytest.mark.slow
ROOT = Path(__file__).parents[3]
SIZE = 256
CODE = np.zeros(256, np.float32)
# Of the emulated headset: metres right, up and backward; degrees about these axes.
MOVES = [(0.02, 0, 0), (0, 0.02, 0), (0, 0, 0.02)]
TURNS = [(15, 0, 0), (0, 20, 0), (0, 0, 10)]


@pytest.fixture(scope="module")
def talker(decoder: Decoder) -> Iterator[Talker]:
    with serving(decoder, head=True) as made:
        made.tick(3)
        yield made


class Run:
    """A tracker, an assembler and the last step of the driver, as a run has them."""

    def __init__(self, talker: Talker, decoder: Decoder) -> None:
        self.source = web_head(talker.link, MonotonicClock(), lambda line: None)
        self._clock, self._assembler, self._count = MonotonicClock(), Assembler(), 0
        shapes = Shapes.of(decoder.rig_names, decoder.to_code, decoder.to_rig)
        self._alive = Alive(shapes, "track")
        self._state = self._alive.init_state()
        self.source.open()

    def tick(self) -> HeadPose:
        """DrivenFrame.head of the frame whose sound ends now, at once after a pose has come:
        a browser without a graphics card may send few of them."""
        packets = self.source.poll()
        wait_until(lambda: packets or packets.extend(self.source.poll()) or packets)
        for packet in packets:
            self._assembler.push(packet)
        sound = np.zeros(1600, np.float32)
        t_ns = self._clock.now_ns() - 33_333_333
        self._assembler.push(AudioPacket(t_ns, 1600 * self._count, sound))
        self._count += 1
        (frame,) = self._assembler.ready()
        shown, self._state = self._alive.step(frame, CODE, AHEAD, False, 0, self._state)
        return shown.head


def test_an_emulated_headset_turns_and_moves_the_head(
    browser: Any, talker: Talker, decoder: Decoder
) -> None:
    page = open_page(browser, f"{talker.address}?bare", SIZE, SIZE, headset(ROOT))
    wait_until(lambda: page.evaluate("!document.getElementById('vr').hidden"))
    page.evaluate("document.getElementById('vr').click()")
    wait_until(lambda: page.evaluate("Boolean(device.activeSession)"))
    run, last = Run(talker, decoder), HeadPose()

    def place(move: tuple[float, ...], turn: tuple[float, ...]) -> HeadPose:
        """Where the head is once the headset has been there for a while."""
        nonlocal last
        half = np.radians(turn) / 2
        x, y, z = np.sin(half)
        w = float(np.prod(np.cos(half)))
        page.evaluate(
            "([p, q]) => { device.position.set(...p); device.quaternion.set(...q); }",
            [[move[0], 1.6 + move[1], move[2]], [float(x), float(y), float(z), w]],
        )
        page.wait_for_timeout(500)
        for _ in range(8):
            page.wait_for_timeout(33)
            last = run.tick()
        return last

    rest = place((0, 0, 0), (0, 0, 0))
    np.testing.assert_allclose(rest.position, 0, atol=0.5)
    for axis, move in enumerate(MOVES):
        wanted = [0.0, 0.0, 0.0]
        wanted[axis] = (-20.0, 20.0, -20.0)[axis]
        np.testing.assert_allclose(place(move, (0, 0, 0)).position, wanted, atol=1)
    for axis, turn in enumerate(TURNS):
        wanted = [0.0, 0.0, 0.0]
        wanted[axis] = turn[axis] * (-1, 1, -1)[axis]
        got = np.degrees(rotation.to_angles(place((0, 0, 0), turn).quat))
        np.testing.assert_allclose(got, wanted, atol=0.2)
    assert page.problems == []
    page.close()


def test_a_turned_head_is_drawn_as_our_renderer_draws_it(
    browser: Any, talker: Talker, who: Identity, renderer: Renderer, decoder: Decoder
) -> None:
    turn = rotation.from_angles((radians(8), radians(22), radians(-6)))
    head = HeadPose((3.0, -2.0, 4.0), turn)
    page = open_page(browser, f"{talker.address}?bare", SIZE, SIZE)
    talker.index += 1
    frame = DrivenFrame(talker.index, 10**9, CODE, AHEAD, head, 0.5)
    none = np.full(2, -1, np.int64)
    silence = SensorFrame(
        talker.index, 10**9, np.zeros(1600, np.float32), None, none > 0, none, False
    )
    talker.sink.on_frame(FrameResult(silence, frame, None))
    wait_until(lambda: page.evaluate("livedrive.frame") == talker.index)
    page.wait_for_timeout(1500)
    shown = screenshot(page)
    pictures = []
    for pose in (head, HeadPose()):
        renderer.draw(decoder.decode(CODE, AHEAD, who, pose, 0.5)[1], cameras.portrait(SIZE, SIZE))
        pictures.append(renderer.read_rgba().copy())
    # The page keeps the light of a head at rest, so the picture is near and not equal.
    assert psnr(shown, pictures[0]) > 27 > 22 > psnr(shown, pictures[1])
    assert page.problems == []
    page.close()
