"""What can be typed in the terminal of a call, and what is answered."""

import sys
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from app.call.live.link import CallLink
    from app.call.live.tape import CallTape

KEYS = "y accepts, m mutes, e mutes the eyes, r agrees to be recorded, a takes offered avatars"


def keys(tape: "CallTape | None") -> str:
    """All of them in a line; `tape`: records at a word, None where a window has a button for it."""
    return f"{KEYS}, {'s records or stops recording, ' if tape else ''}q leaves; then Enter"


def listen(
    link: "CallLink",
    tape: "CallTape | None",
    stop: Callable[[], None],
    tell: Callable[[str], None],
    accepted: bool,
) -> None:
    """Read what is typed, in a thread, as reading blocks."""

    def read() -> None:
        has_accepted = accepted
        for line in sys.stdin:
            word = line.strip().lower()
            if word == "q":
                stop()
                return
            has_accepted |= word in ("y", "yes")
            tell(obey(link, tape, word))
        unheard = "" if has_accepted else ", and you have not accepted: start with --accept"
        tell(f"the terminal has ended: nothing can be typed{unheard}")

    threading.Thread(target=read, name="call keys", daemon=True).start()


def obey(link: "CallLink", tape: "CallTape | None", word: str) -> str:
    """Do what was typed; a line about how it stands now."""
    if word in ("y", "yes"):
        link.change(accepted=True)
        return "you have accepted"
    if word == "m":
        link.change(muted=not link.muted)
        return "your voice is muted" if link.muted else "your voice is not muted"
    if word == "e":
        link.change(eyes_muted=not link.eyes_muted)
        return "your eyes are muted" if link.eyes_muted else "your eyes are not muted"
    if word == "r":
        link.change(may_record=True)
        return "you agree to be recorded"
    if word == "a":
        link.change(takes_avatars=True)
        return "you take avatars that are offered"
    if word == "s" and tape is not None:
        tape.wanted = not tape.wanted
        begins = "you record as soon as everybody agrees; s stops"
        return begins if tape.wanted else "you do not record; s records"
    return keys(tape)
