"""The socket that a page sends its headset's poses to: what is no pose is refused."""

from collections.abc import Iterator
from math import radians

import numpy as np
import pytest
from web_client import Talker, play, serving, socket_to, wait_until

from app.web.headset_source import reading, web_head
from app.web.messages import MESSAGE, PoseMessages
from render.decoder.decoder import Decoder
from sensors import rotation
from sensors.clock import MonotonicClock
from sensors.head.headset import joint
from sensors.types import HeadPose


@pytest.fixture(scope="module")
def talker(decoder: Decoder) -> Iterator[Talker]:
    with serving(decoder, head=True) as made:
        made.tick(3)
        yield made


def test_a_pose_has_its_size_and_no_other() -> None:
    messages = PoseMessages()
    assert messages.packet(bytes(MESSAGE.size), 7) is not None
    assert all(messages.packet(bytes(size), 7) is None for size in (0, 71, 73, 10_000))


@pytest.mark.slow
def test_what_is_no_pose_closes_the_socket_and_nothing_else(talker: Talker) -> None:
    async def work() -> None:
        for bad in (b"", bytes(71), bytes(73), b"x" * 10_000):
            async with socket_to(talker, "pose") as ws:
                await ws.send_bytes(bad)
                assert (await ws.receive()).type.name in ("CLOSE", "CLOSED", "CLOSING")
        async with socket_to(talker, "pose") as ws:
            await ws.send_bytes(MESSAGE.pack(1.0, 0, 1.6, 0, 0, 0, 0, 1, 1))
            await ws.close()

    play(work)
    wait_until(lambda: (talker.link.read(), len(talker.link.poses))[1] > 0)
    source = web_head(talker.link, MonotonicClock(), lambda line: None)
    link_poses = list(talker.link.poses)
    source.open()
    assert source.poll() == [] and len(link_poses) == 1  # what came before is not of this run


def test_the_joint_moves_less_than_the_eyes() -> None:
    turn = rotation.from_angles((0.0, radians(30), 0.0))
    eyes = HeadPose((40.0, 0.0, -11.0), turn)  # about where a turn alone takes them
    assert np.linalg.norm(joint(eyes).position) < 6
    assert joint(HeadPose((5.0, 6.0, 7.0))).position == pytest.approx((5, 6, 7))
    nan = reading(MESSAGE.pack(*[float("nan")] * 9))
    with pytest.raises(ValueError):
        rotation.checked(nan.position, nan.quat)
