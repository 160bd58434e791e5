"""One panel for all places: what was changed last holds, and the others show it."""

from typing import Any

from app.drive.controls import Controls, Panel


class Corner:
    """Window, page or terminal: keeps what it is to show."""

    def __init__(self) -> None:
        self.picked, self.shown = dict[str, Any](), list[dict[str, Any]]()

    def picks(self) -> dict[str, Any]:
        found, self.picked = self.picked, {}
        return found

    def show(self, changed: dict[str, Any]) -> None:
        self.shown.append(changed)


def test_what_was_changed_last_holds_and_all_others_show_it() -> None:
    """Red before: a window did not show what was picked at a page, and neither showed what came
    from the network or the terminal."""
    window, page = Corner(), Corner()
    panel = Panel(Controls("ben"), [window, page])
    assert panel.read() == Controls("ben")
    page.picked = {"emotion": "sad", "muted": True}
    assert panel.read() == panel.read() == Controls("ben", "sad", muted=True)
    window.picked = {"emotion": "happy", "recentred": 1}
    assert panel.read() == Controls("ben", "happy", muted=True, recentred=1)
    page.picked = {"emotion": None}
    assert panel.read() == Controls("ben", muted=True, recentred=1)
    assert window.shown == [{"emotion": "sad", "muted": True}, {"emotion": None}]
    assert page.shown == [{"emotion": "happy"}]  # others have nothing to recentre
