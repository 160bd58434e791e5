"""A sensor that fails is told once, and once more when it is back."""

from types import SimpleNamespace

from app.sinks.sensor_notes import SensorNotes
from sensors.types import NS


def test_a_failing_sensor_is_told_once() -> None:
    """Red before: a run without a terminal was silent about a microphone that never opened."""
    microphone = SimpleNamespace(problem="opening")
    source = SimpleNamespace(microphone=microphone, cameras=[], head=None)
    told: list[str] = []
    notes = SensorNotes(source, told.append)  # type: ignore[arg-type]
    for second in range(10):
        notes.check(second * NS)
        microphone.problem = "" if second == 6 else "no such device"
    assert told == ["microphone: no such device; still looking for it", "microphone: is back"]
    notes.close()
    assert told[2:] == ["microphone: no such device"]


def test_a_head_that_is_lost_is_told() -> None:
    head = SimpleNamespace(name="vmc://:39539", problem="lost")
    source = SimpleNamespace(microphone=None, cameras=[], head=head)
    told: list[str] = []
    notes = SensorNotes(source, told.append)  # type: ignore[arg-type]
    for second in range(10):
        notes.check(second * NS)
        head.problem = "" if second == 6 else "lost"
    assert told == [
        "vmc://:39539: lost; still looking for it",
        "vmc://:39539: is back",
    ]
