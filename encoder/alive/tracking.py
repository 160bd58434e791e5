"""A tracked head: its centre, and the fade when tracking is lost.

A pose is shown as it came, one tick after its packet. Where the tracker loses the head, the head
eases to what it would do without one (rest, or synthesised motion) within EASE_OUT frames.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import radians

from sensors import rotation
from sensors.rotation import REST, UNIT, Quat, Vector
from sensors.types import FPS, HeadPose, SensorFrame

EASE_OUT, EASE_IN = FPS // 2, FPS // 5  # frames: half a second, and a fifth of one
REACH_MM, REACH_RAD = 30.0, radians(60)  # a first pose beyond is measured in a room: it is centred
SLOW = 1 / FPS  # share a frame by which the slow part of the motion follows
MAX_FAST = radians(12)  # of the head's motion, that eyes make up for


@dataclass(frozen=True)
class TrackState:
    """State between frames, a value."""

    pose: HeadPose | None = None  # the newest that was valid, as measured
    position: Vector = (0.0, 0.0, 0.0)  # the centre, mm ...
    yaw: Quat = UNIT  # ... and where ahead is
    begun: bool = False
    share: float = 0.0  # of the tracker, 0..1
    slow: Quat = UNIT  # the slow part of the motion


def recentred(state: TrackState) -> TrackState:
    """Where the head is now is the centre from now on; its pitch and roll stay as measured. Eyes
    have nothing to make up for: that is no motion of the head."""
    if state.pose is None:
        return state
    _, yaw, _ = rotation.to_angles(state.pose.quat)
    ahead = rotation.from_angles((0.0, yaw, 0.0))
    slow = rotation.multiply(rotation.inverse(ahead), state.pose.quat)
    return replace(state, position=state.pose.position, yaw=ahead, slow=slow)


def step(
    frame: SensorFrame, without: HeadPose, state: TrackState
) -> tuple[HeadPose, Quat, TrackState]:
    """The head's pose; the quick part of its motion, that eyes make up for; the state after it.
    `without`: the pose where there is no tracker."""
    valid, is_new = frame.head_valid and frame.head is not None, state.share == 0.0
    if valid:
        state = replace(state, pose=frame.head)
        if not state.begun:
            state = replace(_centred_if_far(state), begun=True, share=1.0)
    by = 1 / EASE_IN if valid else -1 / EASE_OUT
    state = replace(state, share=min(max(state.share + by, 0.0), 1.0))
    if state.pose is None or state.share == 0.0:
        return without, UNIT, state
    tracked = _from_centre(state.pose, state)
    slow = tracked.quat if is_new else rotation.slerp(state.slow, tracked.quat, SLOW)
    eased = state.share * state.share * (3 - 2 * state.share)
    fast = _limited(rotation.multiply(rotation.inverse(slow), tracked.quat), eased)
    return _between(without, tracked, eased), fast, replace(state, slow=slow)


def _centred_if_far(state: TrackState) -> TrackState:
    assert state.pose is not None
    _, yaw, _ = rotation.to_angles(state.pose.quat)
    far = max(map(abs, state.pose.position)) > REACH_MM or abs(yaw) > REACH_RAD
    return recentred(state) if far else state


def _from_centre(pose: HeadPose, state: TrackState) -> HeadPose:
    if state.position == REST.position and state.yaw == UNIT:
        return pose
    back = rotation.inverse(state.yaw)
    x, y, z = (a - b for a, b in zip(pose.position, state.position, strict=True))
    return HeadPose(rotation.rotate(back, (x, y, z)), rotation.multiply(back, pose.quat))


def _between(a: HeadPose, b: HeadPose, share: float) -> HeadPose:
    if share == 1.0:
        return b
    x, y, z = (p + share * (q - p) for p, q in zip(a.position, b.position, strict=True))
    return HeadPose((x, y, z), rotation.slerp(a.quat, b.quat, share))


def _limited(turn: Quat, share: float) -> Quat:
    angle = rotation.angle_between(UNIT, turn)
    if angle < 1e-6:
        return UNIT
    return rotation.slerp(UNIT, turn, share * min(MAX_FAST / angle, 1.0))
