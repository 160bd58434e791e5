"""Where everything in the window lies; pure arithmetic, in ImGui's pixels times `scale`."""

from typing import NamedTuple

SIZE = (1280, 800)  # px of a new window
MIN_SIZE = (840, 560)
SIDEBAR = 348
TOOLBAR_BUTTON, TOOLBAR_GAP = 44, 8
MARGIN = 20


class Rect(NamedTuple):
    """x, y of the upper left corner, width, height."""

    x: float
    y: float
    width: float
    height: float

    @property
    def right(self) -> float:
        return self.x + self.width

    @property
    def bottom(self) -> float:
        return self.y + self.height

    def times(self, factor: float) -> "Rect":
        return Rect(*(factor * value for value in self))

    def overlaps(self, other: "Rect") -> bool:
        return (
            self.x < other.right
            and other.x < self.right
            and self.y < other.bottom
            and other.y < self.bottom
        )


class Layout(NamedTuple):
    """The areas of one window size."""

    view: Rect  # the head
    sidebar: Rect | None
    title: Rect  # upper left corner of the view
    status: Rect  # upper right corner of the view
    toolbar: Rect  # lower middle of the view
    toast: Rect  # above the toolbar


def arrange(width: int, height: int, scale: float, panels: bool, buttons: int) -> Layout:
    """Areas of a window of width x height px with `buttons` in its toolbar."""
    sidebar = None
    view = Rect(0, 0, width, height)
    if panels:
        taken = min(SIDEBAR * scale, width / 2)
        sidebar = Rect(width - taken, 0, taken, height)
        view = Rect(0, 0, width - taken, height)
    margin, row = MARGIN * scale, 52 * scale
    half = (view.width - 3 * margin) / 2
    bar_height = (TOOLBAR_BUTTON + 2 * TOOLBAR_GAP) * scale
    bar_width = (buttons * (TOOLBAR_BUTTON + TOOLBAR_GAP) + TOOLBAR_GAP) * scale
    toolbar = Rect(
        (view.width - bar_width) / 2, height - margin - bar_height, bar_width, bar_height
    )
    toast_width = min(460 * scale, view.width - 2 * margin)
    return Layout(
        view=view,
        sidebar=sidebar,
        title=Rect(margin, margin, half, row),
        status=Rect(view.width - margin - half, margin, half, row),
        toolbar=toolbar,
        toast=Rect((view.width - toast_width) / 2, toolbar.y - row, toast_width, 40 * scale),
    )


def toolbar_button(toolbar: Rect, index: int, scale: float) -> Rect:
    """The area of one button."""
    step, gap = (TOOLBAR_BUTTON + TOOLBAR_GAP) * scale, TOOLBAR_GAP * scale
    size = TOOLBAR_BUTTON * scale
    return Rect(toolbar.x + gap + index * step, toolbar.y + gap, size, size)
