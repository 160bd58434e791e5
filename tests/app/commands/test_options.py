"""What options become where nothing is said."""

from typing import Any

import pytest

from app.commands.calibrate import Calibrate
from app.commands.meet.call import CallOptions
from app.commands.options import DriveOptions
from render.types import Density
from sensors.types import InputError


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


def test_an_address_without_a_page_is_told() -> None:
    with pytest.raises(InputError, match="--host 0.0.0.0: expected a page .* add --web 8443"):
        DriveOptions(host="0.0.0.0").settings(realtime=False, draw=True, title="")
    with pytest.raises(InputError, match="--host ::: expected a page"):
        Calibrate(host="::", eyes=("uvc:0",)).run()
    with pytest.raises(InputError, match="--web: expected --eyes"):
        Calibrate(web=8443, undo=True).run()
    with pytest.raises(InputError, match="--host: expected an address, got ''"):
        DriveOptions(host="", web=8443).settings(realtime=False, draw=True, title="")
    shown = DriveOptions(host="0.0.0.0", web=8443).settings(realtime=False, draw=True, title="")
    assert (shown.network.web, shown.network.host) == (8443, "0.0.0.0")
