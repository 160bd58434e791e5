"""What the window knows without a screen: its areas, shared memory and history."""

import numpy as np
import pytest

from app.window.state import picks
from app.window.state.history import KEPT, History
from app.window.state.layout import MIN_SIZE, SIZE, arrange, toolbar_button
from app.window.state.shared import SLOTS, SharedMemory, WindowInfo
from sensors.types import NS


@pytest.mark.parametrize("panels", [True, False])
@pytest.mark.parametrize(
    "size,scale",
    [(MIN_SIZE, 1.0), (SIZE, 1.0), (SIZE, 1.5), ((1920, 1080), 1.5), ((3840, 2160), 2.0)],
)
def test_no_two_areas_overlap(size: tuple[int, int], scale: float, panels: bool) -> None:
    layout = arrange(*size, scale, panels, buttons=8)
    areas = [layout.title, layout.status, layout.toolbar, layout.toast]
    areas += [layout.sidebar] if layout.sidebar else []
    for k, area in enumerate(areas):
        assert area.x >= 0 and area.y >= 0 and area.right <= size[0] and area.bottom <= size[1]
        assert not any(area.overlaps(other) for other in areas[k + 1 :])
    buttons = [toolbar_button(layout.toolbar, k, scale) for k in range(8)]
    assert not any(a.overlaps(b) for a, b in zip(buttons, buttons[1:], strict=False))
    assert all(layout.toolbar.overlaps(b) and b.right < layout.toolbar.right for b in buttons)


def test_ticks_arrive_whole_and_the_oldest_are_overwritten() -> None:
    memory = SharedMemory()
    assert memory.ticks.after(-1) == []
    for k in range(SLOTS + 5):
        memory.ticks.post(index=k, t_ns=k * NS, expression=np.full(256, k), eyes=k)
    found = memory.ticks.after(-1)
    assert [int(t["number"]) for t in found] == list(range(5, SLOTS + 5))
    assert all((t["eyes"] == t["number"]).all() for t in found)
    assert [int(t["index"]) for t in memory.ticks.after(SLOTS + 2)] == [SLOTS + 3, SLOTS + 4]
    memory.ticks.post(index=99)
    assert found[-1]["index"] == SLOTS + 4  # a copy
    memory.close()


def test_a_tick_in_the_making_is_not_read() -> None:
    memory, seen = SharedMemory(), []
    for k in range(SLOTS):
        memory.ticks.post(index=k)

    class Spy:
        """A value that looks at the ring while it is being written into it."""

        def __array__(self, dtype: object = None, copy: object = None) -> np.ndarray:
            seen.append([int(t["number"]) for t in memory.ticks.after(-1)])
            return np.zeros(256, np.float32)

    memory.ticks.post(index=SLOTS, expression=Spy())  # over tick 0
    assert seen and all(numbers == list(range(1, SLOTS)) for numbers in seen)
    memory.close()


def test_history_keeps_its_size_and_counts() -> None:
    history, memory = History(), SharedMemory()
    for k in range(KEPT + 10):
        memory.ticks.post(
            index=k, stage_ms=np.full(10, k), level=(0.1, 1.0), audio_gap=k < 4, dropped=2
        )
        history.add(memory.ticks.after(k - 1)[-1])
    assert history.stage_ms.shape[0] == KEPT and history.tick_ms(100) == KEPT + 9
    assert (history.frames, history.dropped, history.audio_gaps) == (KEPT + 10, 2, 4)
    assert history.level_db == pytest.approx(-20, abs=0.1) and history.peak_db == pytest.approx(0)
    memory.close()


def test_controls_of_others_are_shown_in_the_window() -> None:
    """Red before: a mixture on the command line ended a run with --window in a traceback."""
    memory, info = SharedMemory(), WindowInfo("x", "ben", ("ada", "ben"), ("happy", "sad"))
    row = memory.controls
    for words, read in (
        ("happy", "happy"),
        ("sad:0.7", "sad:0.70"),
        ("happy:0.5+sad:0.3", "happy:0.5+sad:0.3"),
        ("neutral", "neutral"),
        ("", None),
        (None, None),
    ):
        picks.write(row, info, {"emotion": words})
        assert picks.read(row, info).emotion == read
    picks.write(row, info, {"avatar": "ben", "muted": True})
    picks.write(row, info, {"avatar": "made since"})
    assert picks.read(row, info).avatar == "ben" and picks.read(row, info).muted
    memory.close()
