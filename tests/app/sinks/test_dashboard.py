"""The dashboard shows what a sensor says of itself, whatever it says."""

import io
from types import SimpleNamespace

from app.sinks.dashboard import Dashboard
from app.sinks.live_stats import LiveStats
from app.terminal.console import console


def test_words_of_a_camera_are_words() -> None:
    """Red before: MarkupError, and with it the end of the dashboard and of the report."""
    counts = SimpleNamespace(damaged=0, connects=0, pictures=0)
    camera = SimpleNamespace(
        views=SimpleNamespace(eyes=(0,)),
        counts=counts,
        problem="HTTP/1.1 404 [/boom] [bold]:wave: \x1b]0;mine\x07",
    )
    source = SimpleNamespace(microphone=None, cameras=[camera])
    screen = console(width=150)
    screen.file = io.StringIO()
    screen.print(Dashboard(source, LiveStats()).render())  # type: ignore[arg-type]
    shown = screen.file.getvalue()
    assert "[/boom] [bold]:wave:" in shown and "0 reconnects" in shown
    assert r"\x1b]0;mine\x07" in shown and "\x1b" not in shown  # red before: a title of theirs
