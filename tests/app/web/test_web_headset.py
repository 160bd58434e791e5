"""The page and the head's pose: a headset's arrives in the driven frame, a turned head is drawn."""

from collections.abc import Iterator
from dataclasses import replace
from math import radians
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from browser import headset, open_page, screenshot
from web_client import Talker, psnr, serving, wait_until

from app.drive.sink import FrameResult
from app.web.headset_source import web_head
from app.web.messages import MESSAGE
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
from sensors.types import NS, AudioPacket, HeadPacket, HeadPose, SensorFrame

pytestmark = pytest.mark.slow
ROOT = Path(__file__).parents[3]
SIZE = 256
# Software GL takes seconds for a picture of a busy machine; poses are sent before it is drawn.
UNDRAWN = "WebGL2RenderingContext.prototype.drawElements = () => {};"
# Who enters as soon as the button is there must not be too early for what the server answers.
SLOW_ANSWERS = """
const fetchAtOnce = fetch;
fetch = async (...what) => {
  await new Promise((done) => setTimeout(done, 1000));
  return fetchAtOnce(...what);
};
"""
TICK_NS = NS // 30
CODE = np.zeros(256, np.float32)
# Of the emulated headset: metres right, up and backward; degrees about these axes. Poses may come a
# few ms apart: steps within ReadingGate's tolerance are no jumps, however soon.
MOVES = [(0.02, 0, 0), (0, 0.02, 0), (0, 0, 0.02)]
TURNS = [(10, 0, 0), (0, 12, 0), (0, 0, 8)]


@pytest.fixture(scope="module")
def talker(decoder: Decoder) -> Iterator[Talker]:
    with serving(decoder, head=True) as made:
        made.tick(3)
        yield made


class Run:
    """A tracker, an assembler and the last step of the driver, as a run has them: frames end at a
    fixed pace, whenever poses come."""

    def __init__(self, talker: Talker, decoder: Decoder) -> None:
        self.talker = talker
        self.source = web_head(talker.link, MonotonicClock(), lambda line: None)
        self._assembler, self._count = Assembler(), 0
        shapes = Shapes.of(decoder.rig_names, decoder.to_code, decoder.to_rig)
        self._alive = Alive(shapes, "track")
        self._state = self._alive.init_state()
        self.source.open()
        self._start_ns = MonotonicClock().now_ns()

    def poses(self) -> list[tuple[float, int, HeadPacket]]:
        """What came since: the page's time in ms, when it came here, and what was made of it."""
        self.talker.link.read()
        came = [(MESSAGE.unpack(m)[0], t_ns) for t_ns, m in self.talker.link.poses]
        with patch.object(self.talker.link, "read"):  # what comes meanwhile is of the next call
            packets = [p for p in self.source.poll() if isinstance(p, HeadPacket)]
        assert len(came) == len(packets)
        return [(*row, packet) for row, packet in zip(came, packets, strict=True)]

    def frames_before(self, t_ns: int) -> None:
        """Make the frames that end before `t_ns`."""
        while self._start_ns + (self._count + 1) * TICK_NS < t_ns:
            self.frame()

    def frame(self) -> tuple[SensorFrame, HeadPose]:
        """The next frame, and DrivenFrame.head."""
        begins_ns = self._start_ns + self._count * TICK_NS
        sound = np.zeros(1600, np.float32)
        self._assembler.push(AudioPacket(begins_ns, 1600 * self._count, sound))
        self._count += 1
        (frame,) = self._assembler.ready()
        shown, self._state = self._alive.step(frame, CODE, AHEAD, False, 0, self._state)
        return frame, shown.head

    def push(self, packet: HeadPacket) -> None:
        self._assembler.push(packet)


def test_an_emulated_headset_turns_and_moves_the_head(
    browser: Any, talker: Talker, decoder: Decoder
) -> None:
    """On all six axes, both ways, in the first frame that ends after the pose came."""
    page = open_page(
        browser, f"{talker.address}?bare", SIZE, SIZE, headset(ROOT), UNDRAWN, SLOW_ANSWERS
    )
    wait_until(lambda: page.evaluate("!document.getElementById('vr').hidden"))
    page.evaluate("document.getElementById('vr').click()")
    wait_until(lambda: page.evaluate("Boolean(device.activeSession)"))
    run = Run(talker, decoder)

    def place(move: tuple[float, ...], turn: tuple[float, ...]) -> HeadPose:
        """Where the head is one tick after the first pose from there has come: the emulator tells
        its place a frame late."""
        half = np.radians(turn) / 2
        w, (x, y, z) = float(np.prod(np.cos(half))), np.sin(half)
        moved_ms = page.evaluate(
            "([p, q]) => { device.position.set(...p); device.quaternion.set(...q);"
            " return performance.now(); }",
            [[move[0], 1.6 + move[1], move[2]], [float(x), float(y), float(z), w]],
        )
        seen: list[tuple[float, int, HeadPacket]] = []

        def has_moved() -> bool:
            page.wait_for_timeout(20)
            seen.extend(run.poses())
            return sum(time_ms >= moved_ms for time_ms, *_ in seen) >= 2

        wait_until(has_moved)
        after = False
        for time_ms, came_ns, packet in seen:
            # By the page's clock it may be old: a browser without a graphics card is slow.
            run.frames_before(came_ns)
            run.push(replace(packet, t_ns=came_ns))
            if time_ms >= moved_ms and after:
                frame, head = run.frame()
                assert frame.head == packet.pose and frame.head_valid
                return head
            after |= time_ms >= moved_ms  # a busy browser's times may step back between the two
        raise AssertionError("no pose of the moved headset")

    rest = place((0, 0, 0), (0, 0, 0))
    for sign in (1, -1):
        for axis, ours in enumerate((-1, 1, -1)):
            move, turn = sign * np.array(MOVES[axis]), sign * np.array(TURNS[axis])
            shifted = place(tuple(move), (0, 0, 0))
            moved = np.subtract(shifted.position, rest.position)
            np.testing.assert_allclose(moved, 1e3 * ours * move, atol=1)
            turned = np.degrees(rotation.to_angles(place((0, 0, 0), tuple(turn)).quat))
            np.testing.assert_allclose(turned, ours * turn, atol=0.2)
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
    pictures = []
    for pose in (head, HeadPose()):
        renderer.draw(decoder.decode(CODE, AHEAD, who, pose, 0.5)[1], cameras.portrait(SIZE, SIZE))
        pictures.append(renderer.read_rgba().copy())
    # The page keeps the light of a head at rest, so the picture is near and not equal.
    wait_until(lambda: psnr(screenshot(page), pictures[0]) > 27)
    assert psnr(screenshot(page), pictures[1]) < 22
    assert page.problems == []
    page.close()
