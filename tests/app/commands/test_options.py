"""What options become where nothing is said."""

from typing import Any

import pytest

from app.commands.meet.call import CallOptions
from app.commands.options import DriveOptions
from render.types import Density


@pytest.mark.parametrize(
    ("given", "density"),
    [
        ({}, "65k"),
        ({"window": True}, "65k"),
        ({"web": 8443}, "32k"),
        ({"xr": ("headless",)}, "32k"),
        ({"web": 8443, "gaussians": "65k"}, "65k"),
        ({"gaussians": "16k"}, "16k"),
    ],
)
def test_a_head_alone_has_65k(given: dict[str, Any], density: Density) -> None:
    options = DriveOptions(**given)
    assert options.settings(realtime=False, draw=True, title="").gaussians == density


def test_partners_of_a_call_share_the_machine() -> None:
    settings = CallOptions(headless=True).live_drive_settings("call", in_call=True)
    assert settings.gaussians == "32k"
