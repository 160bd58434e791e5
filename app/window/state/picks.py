"""The window's controls in shared memory as the Controls of a run, and back."""

from typing import Any

import numpy as np

from app.drive.controls import Controls
from app.window.state.shared import WindowInfo


def read(row: np.void, info: WindowInfo) -> Controls:
    """What the person at the window asks for."""
    return Controls(
        avatar=info.avatars[int(row["avatar"])],
        emotion=_emotion(row, info),
        muted=bool(row["muted"]),
        recording=bool(row["recording"]),
        recentred=int(row["recentred"]),
        resets=int(row["resets"]),
        closed=bool(row["closed"]),
    )


def write(row: np.void, info: WindowInfo, changed: dict[str, Any]) -> None:
    """Show avatar, emotion or mute as they were changed elsewhere."""
    if changed.get("avatar") in info.avatars:
        row["avatar"] = info.avatars.index(changed["avatar"])
    if "muted" in changed:
        row["muted"] = changed["muted"]
    if "emotion" in changed:
        _show_emotion(row, info, changed["emotion"] or "")


def _emotion(row: np.void, info: WindowInfo) -> str | None:
    names = (*info.emotions, bytes(row["words"]).decode())
    if row["emotion"] < 0:
        return None
    words = names[int(row["emotion"])]
    weaker = row["emotion"] < len(info.emotions) and row["intensity"] < 1
    return f"{words}:{row['intensity']:.2f}" if weaker else words


def _show_emotion(row: np.void, info: WindowInfo, words: str) -> None:
    name, _, intensity = words.partition(":")
    if name.strip() in info.emotions and "+" not in words:
        row["intensity"] = float(intensity or 1)
        row["emotion"] = info.emotions.index(name.strip())
    elif words:
        row["words"] = words.encode()
        row["emotion"] = len(info.emotions)
    else:
        row["emotion"] = -1
