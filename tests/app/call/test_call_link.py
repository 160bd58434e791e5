"""The loop's end of a call, whose process is slow."""

import numpy as np

from app.call.live import protocol
from app.call.live.link import CallLink
from app.call.live.protocol import CallSettings


def test_a_mute_is_not_lost_behind_sound() -> None:
    """Red before: 2.4 s of stall sufficed, and the voice went on while all showed it as muted."""
    link = CallLink(CallSettings(name="a", avatar="ben"), print)
    theirs = link._theirs  # noqa: SLF001
    sound = protocol.pack_sound(0, 0, np.zeros(480, np.float32))
    for _ in range(400):
        link.post(sound)
    link.change(muted=True)
    kinds = [packet[:1] for packet in theirs.waiting()]
    link.post(sound)
    kinds += [packet[:1] for packet in theirs.waiting()]
    assert kinds.count(protocol.STATE) == 1 and not link.ended
    link.close()
