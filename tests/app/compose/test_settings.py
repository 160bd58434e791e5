"""Values that cannot be used are told in one line before anything starts."""

import pytest

from app.compose.settings import DriveSettings, FileSettings, LiveSettings
from sensors.types import InputError


@pytest.mark.parametrize(
    ("settings", "values", "what"),
    [
        (DriveSettings, {"seed": -1}, "--seed"),
        (DriveSettings, {"seed": 1 << 80}, "--seed"),
        (DriveSettings, {"listen": 70_000}, "--listen"),
        (DriveSettings, {"emotion": ""}, "got ''; try --emotion neutral"),
        (DriveSettings, {"emotion": " "}, "--emotion"),
        (FileSettings, {"every": 0}, "--every"),
        (LiveSettings, {"seconds": float("nan")}, "--seconds"),
        (LiveSettings, {"seconds": float("inf")}, "--seconds"),
    ],
)
def test_values_that_cannot_be_used(settings: type, values: dict, what: str) -> None:
    with pytest.raises(InputError, match=what):
        settings(**values)
