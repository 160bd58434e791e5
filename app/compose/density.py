"""How many Gaussians a live run draws: as many as this computer draws in time, unless it is told.

Before the first frame, as many as the settings say are drawn a few times, then fewer.
"""

from dataclasses import replace
from typing import TYPE_CHECKING, get_args

from app.compose.live import tell
from app.compose.settings import DriveSettings
from render.types import Density
from sensors.types import NS, Clock

if TYPE_CHECKING:
    from render.decoder.decoder import Decoder
    from render.decoder.identity import Identity

# Decode and draw, at best: other programs start beside this one, and the rest of the 33 ms of a
# frame belongs to the networks, to windows, and to pictures that take longer.
PICTURE_MS = 14.0
PICTURES = 9  # that are timed


def load_decoder(settings: DriveSettings, who: "Identity", clock: Clock) -> "Decoder":
    """The decoder of the settings; of fewer Gaussians where pictures of so many come too late and
    the settings allow it."""
    from render.decoder.decoder import Decoder

    decoder = Decoder.load(gaussians=settings.gaussians)
    densities = get_args(Density)  # the fewest first
    fewer = densities[: densities.index(settings.gaussians)]
    live = settings.realtime and (settings.needs_picture or settings.window)
    if not (fewer and settings.fewer and live):
        return decoder
    if (took := picture_ms(settings, decoder, who, clock)) <= PICTURE_MS:
        return decoder
    tell(
        f"a picture of {settings.gaussians} Gaussians takes {took:.0f} ms here, too long for 30 a "
        f"second: {fewer[-1]} are drawn; --gaussians {settings.gaussians} draws them all"
    )
    return load_decoder(replace(settings, gaussians=fewer[-1]), who, clock)


def picture_ms(settings: DriveSettings, decoder: "Decoder", who: "Identity", clock: Clock) -> float:
    """Time of the fastest of some pictures of a turned head."""
    from app.drive.view import PortraitView
    from render import cameras
    from render.splats.renderer import create_renderer

    camera = cameras.portrait(settings.size, settings.size)
    view, taken = PortraitView(decoder, who, create_renderer(), camera), list[int]()
    try:
        view.warm_up()
        for _ in range(PICTURES):
            start_ns = clock.now_ns()
            view.warm_up()
            taken.append(clock.now_ns() - start_ns)
    finally:
        view.close()
    return min(taken) * 1000 / NS
