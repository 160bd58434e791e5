"""The headset's poses as a HeadSource: what `--head web` and `--head auto` with a page listen to.

    page -> server's process -> ServerLink.poses -> Gate -> HeadSource.poll -> LiveSource

WebXR tells where the point between the eyes is. A head turns about its joint behind and below
them, so the way of the joint is what counts as the head's position.
"""

from collections.abc import Callable

from app.web.link import ServerLink
from app.web.messages import MESSAGE
from sensors import rotation
from sensors.head.gate import Gate, Reading
from sensors.head.source import HeadSource
from sensors.rotation import UNIT
from sensors.types import Clock, HeadPacket, HeadPose

JOINT_MM = (0.0, -65.0, -85.0)  # from the point between the eyes, in the head's own axes
NAME, NAN = "web", float("nan")


class HeadsetLink:
    """Takes the poses that the server has passed on."""

    def __init__(self, link: ServerLink, tell: Callable[[str], None]) -> None:
        self._link, self._gate = link, Gate(NAME, tell)
        self.counts = self._gate.counts

    def open(self) -> None:
        self._link.poses.clear()

    def poll(self) -> list[HeadPacket]:
        self._link.read()
        packets: list[HeadPacket] = []
        while self._link.poses:
            arrival_ns, message = self._link.poses.popleft()
            packet = self._gate(reading(message), arrival_ns)
            if packet is not None:
                packets.append(packet)
        return packets

    def close(self) -> None:
        self._link.poses.clear()


def web_head(
    link: ServerLink, clock: Clock, tell: Callable[[str], None], expected: bool = True
) -> HeadSource:
    """The headset of the page behind `link`."""
    return HeadSource(NAME, lambda: HeadsetLink(link, tell), clock, expected)


def reading(message: bytes) -> Reading:
    """A page's message as a reading; one that is no pose is read as one that Gate refuses."""
    time_ms, x, y, z, *turn, tracked = MESSAGE.unpack(message)
    try:
        eyes = rotation.from_xr((x, y, z), turn)
    except (ValueError, OverflowError):
        return Reading((NAN, NAN, NAN), UNIT)
    pose = joint(eyes)
    return Reading(pose.position, pose.quat, time_ms / 1e3, tracked > 0)


def joint(eyes: HeadPose) -> HeadPose:
    """The pose of the head's joint, from that of the point between the eyes."""
    turned = rotation.rotate(eyes.quat, JOINT_MM)
    x, y, z = (p + t - j for p, t, j in zip(eyes.position, turned, JOINT_MM, strict=True))
    return HeadPose((x, y, z), eyes.quat)
