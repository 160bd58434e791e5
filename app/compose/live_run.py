"""A live run: sensors, page, driver and statistics, as `run` and `call` share them."""

from collections.abc import Generator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.compose.build import build, load_driver
from app.compose.live import live_source, open_page, open_recorder, open_xr
from app.compose.report import report, sensor_report
from app.compose.settings import CONDITION, HEAD_MODE, SEED, DriveSettings, LiveSettings
from app.drive.calibration import in_session, of_user
from app.drive.controls import ControlPlace
from app.drive.loop import Drive, Summary
from app.drive.sink import Sink

if TYPE_CHECKING:
    from app.call.live.link import CallLink
    from app.call.live.tape import CallTape
    from app.call.table.seats import Seats
    from app.drive.tape import Tape
    from sensors.live.recorder import LiveRecorder


class LiveRun:
    """Raises InputError where a sensor, the page or the networks cannot be had as asked for."""

    def __init__(
        self,
        live: LiveSettings,
        settings: DriveSettings,
        seats: "Seats | None" = None,  # of a call: partners are drawn too
    ) -> None:
        from app.sinks.live_stats import LiveStats
        from sensors.clock import MonotonicClock

        self.settings, self.clock, self.stats = settings, MonotonicClock(), LiveStats()
        self._seats = seats
        handle = seats.handle if seats else None
        self._page, self._xr = open_page(settings, self.clock, handle), None
        with self._closed_on_failure():
            self._xr = open_xr(settings, self.clock, handle)
            self.source = live_source(live, self.clock, self._page, self._xr)
            self._driver = load_driver(settings, bool(self.source.info.eyes), of_user())

    def open_recorder(self, folder: Path) -> "LiveRecorder":
        """Record into a new session, with what its replay needs to be the same."""
        known = in_session(self._driver) | {HEAD_MODE: self.settings.head}
        known |= {CONDITION: self._driver.config.condition, SEED: self.settings.seed or 0}
        return open_recorder(folder, self.source, known)

    def hear_at_page(self, link: "CallLink") -> None:
        """Let the page play the partners of a call, where the settings ask for it."""
        if self._page and self.settings.network.sound:
            link.on_played.append(self._page.link.hear)

    def build(
        self,
        tape: "Tape | CallTape",
        sinks: Sequence[Sink] = (),
        places: Sequence[ControlPlace] = (),
    ) -> Drive:
        from sensors.audio.portaudio import silence_native_messages

        silence_native_messages()
        with self._closed_on_failure():
            return build(
                self.settings,
                source=self.source,
                driver=self._driver,
                clock=self.clock,
                sinks=[self.stats, *sinks],
                tape=tape,
                page=self._page,
                xr=self._xr,
                seats=self._seats,
                places=places,
            )

    @contextmanager
    def _closed_on_failure(self) -> Generator[None]:
        """No process outlives a run that does not begin; what began, `drive` closes."""
        try:
            yield
        except BaseException:
            for sink in (self._page, self._xr):
                if sink is not None:
                    sink.close()
            raise

    def report(self, parts: Drive, summary: Summary) -> dict[str, Any]:
        """What the run, its latency statistics and its sensors counted."""
        values = report(self.settings, parts, summary) | self.stats.report()
        return values | {"sensors": sensor_report(self.source)}
