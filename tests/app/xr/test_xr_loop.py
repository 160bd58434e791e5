"""The headset's loop on the runtime for tests: pictures, poses, losses and returns."""

from collections.abc import Callable, Iterator
from itertools import pairwise

import numpy as np
import pytest

from app.xr.headset import xr_head
from app.xr.link import XrInfo, XrMemory
from app.xr.loop import XrLoop
from app.xr.place import eye_camera, in_front
from app.xr.runtimes.protocol import NoRuntimeError
from app.xr.runtimes.standin import StandInRuntime, motion
from app.xr.scene import Scene
from render.decoder.decoder import Decoder
from render.decoder.identity import Identity
from render.gl.contexts import GLContext, create_context
from render.types import AHEAD, Renderer
from sensors import rotation
from sensors.clock import ManualClock
from sensors.head.headset import joint
from sensors.types import FPS, NS, HeadPacket

pytestmark = pytest.mark.slow

SIZE = (160, 144)
BEHIND = (0.16, 0.16, 0.16)
PATIENCE = 50_000  # looks at whether it has come


@pytest.fixture(scope="module")
def context() -> Iterator[GLContext]:
    made = create_context()
    yield made
    made.close()


class Headset:
    """A runtime, a loop and the memory between it and a run, on a clock of their own."""

    def __init__(self, context: GLContext | None) -> None:
        self.clock, self.memory = ManualClock(NS), XrMemory()
        self.status, self.there, self.scenes = self.memory.status, True, list[Scene]()
        self.status["avatar"] = b"ben"
        self.runtime = StandInRuntime(
            self.clock, context=context, size=SIZE, is_there=lambda: self.there
        )
        self._loop = XrLoop(self.runtime, self.memory, self._scene, self.clock, self._wanted)

    def run(self, done: Callable[[], bool]) -> None:
        """Until it is done."""
        self._done, self._left = done, PATIENCE
        self._loop.run()

    def tick(self, index: int, **moved: object) -> None:
        t_ns = self.clock.now_ns() + index * NS // FPS
        fields: dict[str, object] = {"t_ns": t_ns, "posted_ns": t_ns, "expression": 0.0}
        fields |= {"gaze": AHEAD, "head": (0, 0, 0, 1, 0, 0, 0, 0)}
        self.memory.ticks.post(**(fields | moved))

    def _wanted(self) -> bool:
        self._left -= 1
        assert self._left, "it never came"
        return not self._done()

    def _scene(self, context: GLContext) -> Scene:
        info = XrInfo("auto", "ben", gaussians="16k")
        scene = Scene(context, info, lambda: self.memory.text("avatar"))
        scene.close = lambda: None  # the context is that of all tests
        self.scenes.append(scene)
        return scene


def test_both_eyes_get_the_pictures_of_the_stereo_renderer(
    context: GLContext, who: Identity, renderer: Renderer
) -> None:
    headset, decoder = Headset(context), Decoder.load(gaussians="16k")
    rig = np.zeros(len(decoder.rig_names), np.float32)
    rig[decoder.rig_names.index("jawOpen")] = 0.8
    face = decoder.encode(rig)
    aside = np.array([[0.2, 0.1, 0.97]] * 2, np.float32)
    aside /= np.linalg.norm(aside, axis=1, keepdims=True)
    headset.tick(0, expression=face, gaze=aside, head=(3, 0, 0, 1, 0, 0, 0, 0.5))
    headset.run(lambda: headset.runtime.ended_frames >= 1)
    eyes, pictures = headset.runtime.eyes, headset.runtime.pictures()
    assert eyes is not None

    pose = rotation.checked((3, 0, 0), (1, 0, 0, 0))
    _, cloud = decoder.decode(face, aside, who, pose, 0.5)
    place = in_front(eyes, who.eye_centers.mean(0))
    for eye, picture in zip(eyes, pictures, strict=True):
        renderer.draw(cloud, eye_camera(eye, place, *SIZE, BEHIND))
        wanted = renderer.read_rgba()[..., :3].astype(int)
        assert np.abs(picture[..., :3].astype(int) - wanted).max() <= 1
        assert wanted[72, 60:100].std() > 10  # somebody is there
        assert (picture[..., 3] == 255).all()
    assert np.abs(pictures[0].astype(int) - pictures[1]).max() > 30


def test_the_face_moves_between_ticks(context: GLContext) -> None:
    headset = Headset(context)
    for index in range(3):
        headset.tick(index, expression=0.2 * index)
    headset.run(lambda: headset.status["frames"] >= 1)
    moments = (NS + (10 + part) * NS // (10 * FPS) for part in (2, 4, 6, 8))
    means = [headset.scenes[0].cloud(moment).means.copy() for moment in moments]
    steps = [np.abs(b - a).mean() for a, b in pairwise(means)]
    assert min(steps) > 0 and max(steps) < 1.5 * min(steps)


def test_another_avatar_is_seen_in_the_headset_too(context: GLContext) -> None:
    """Red before: everybody saw the new one but the wearer."""
    headset = Headset(context)
    headset.run(lambda: headset.status["frames"] >= 1)
    before = headset.scenes[0].cloud(headset.clock.now_ns()).colors.copy()
    headset.status["avatar"] = b"/gone/nobody.safetensors"
    assert np.array_equal(headset.scenes[0].cloud(headset.clock.now_ns()).colors, before)
    headset.status["avatar"] = b"femi"
    after = headset.scenes[0].cloud(headset.clock.now_ns()).colors
    assert after[:1000].mean() < 0.7 * before[:1000].mean()  # her skin is darker


def test_a_lost_runtime_is_looked_for_and_comes_back(context: GLContext) -> None:
    headset = Headset(context)
    headset.run(lambda: headset.status["frames"] >= 3)
    assert headset.memory.text("runtime") == "stand-in"
    assert (headset.status["width"], headset.status["height"]) == SIZE
    headset.there = False
    headset.run(lambda: headset.clock.now_ns() > 60 * NS)
    assert headset.memory.text("problem") and headset.status["frames"] == 3
    headset.there, back_ns = True, headset.clock.now_ns()
    headset.run(lambda: headset.status["frames"] >= 4)
    assert headset.clock.now_ns() - back_ns < 3 * NS
    assert headset.memory.text("problem") == "" and len(headset.scenes) == 1


def test_a_session_that_is_lost_while_it_draws_is_counted(context: GLContext) -> None:
    headset = Headset(context)

    def lost() -> bool:
        if headset.status["frames"] == 2:
            headset.runtime.lost = True
        return bool(headset.status["losses"])

    headset.run(lost)
    assert headset.memory.text("problem") == "the runtime has gone"
    lost_ns = headset.clock.now_ns()
    headset.run(lambda: headset.status["frames"] >= 5)
    assert headset.status["losses"] == 1 and headset.runtime.opened == 2
    assert headset.clock.now_ns() - lost_ns < 3 * NS


def test_without_a_runtime_at_the_start_there_is_an_error() -> None:
    headset = Headset(None)
    headset.there = False
    with pytest.raises(NoRuntimeError, match="expected the runtime"):
        headset.run(lambda: False)
    assert not headset.status["ready"]


def test_who_ends_it_in_the_headset_is_left_alone(context: GLContext) -> None:
    headset = Headset(context)
    headset.runtime.ended = True
    headset.run(lambda: False)  # ends by itself
    assert headset.status["ended"] and headset.runtime.opened == 1


def test_nothing_is_drawn_out_of_sight_and_the_head_still_turns(context: GLContext) -> None:
    headset = Headset(context)
    headset.runtime.focused = False
    headset.run(lambda: headset.status["poses"] >= 5)
    assert headset.status["frames"] == 0
    headset.runtime.focused = True
    headset.run(lambda: headset.status["frames"] >= 2)


def test_the_head_stands_before_the_wearer_anew_when_they_ask_for_it(context: GLContext) -> None:
    headset, drawn = Headset(context), list[np.ndarray]()
    runtime = headset.runtime

    def three() -> bool:
        if headset.status["frames"] == len(drawn) + 1:
            drawn.append(runtime.pictures()[0].astype(int))
            headset.clock.advance_ns(NS)  # the wearer moves on
            runtime.recentred += len(drawn) == 2
        return len(drawn) == 3

    headset.run(three)
    before, moved, anew = (picture[:, 40:120] for picture in drawn)
    assert np.abs(before - moved).mean() > 2 * np.abs(before - anew).mean()


def test_headless_poses_become_the_head() -> None:
    headset, told = Headset(None), list[str]()
    source = xr_head(headset.memory, headset.clock, told.append)
    source.open()
    assert source.problem
    headset.run(lambda: headset.status["poses"] >= 3)
    assert headset.status["frames"] == 0
    packets = [packet for packet in source.poll() if isinstance(packet, HeadPacket)]
    assert len(packets) >= 3 and not source.problem and not told
    for packet in packets:
        (x, y, z), (a, b, c, d) = motion(packet.t_ns)
        wanted = joint(rotation.checked((-1e3 * x, 1e3 * y, -1e3 * z), (d, -a, b, -c)))
        assert packet.pose.position == pytest.approx(wanted.position, abs=1e-6)
        assert packet.pose.quat == pytest.approx(wanted.quat, abs=1e-9)
    assert [p.t_ns for p in packets] == sorted({p.t_ns for p in packets})
    source.close()
