"""`livedrive calibrate`: a routine of ten seconds that fits gaze and lids to one person."""

from dataclasses import dataclass
from typing import Annotated

import tyro

from app.terminal.arguments import File, Port, check_host
from sensors.types import LOOPBACK, InputError


@dataclass(kw_only=True)
class Calibrate:
    """Fit gaze and lids to you: look at five points, blink, close your eyes. `run` uses the fit.

    The previous fit is kept beside the new one; --undo restores it.
    """

    eyes: Annotated[tuple[str, ...], tyro.conf.arg(metavar="SPEC ...")] = ()
    """Cameras, as for livedrive run."""
    session: File = None
    """Instead of cameras: a session recorded while following the targets."""
    out: File = None
    """File to write; default: your profile, which `run` reads."""
    web: Port = None
    """Show the targets on a web page at this port, also in a headset, e.g. --web 8443; else the
    terminal names them."""
    host: str = LOOPBACK
    """Address that --web listens on, as for livedrive run."""
    undo: bool = False
    """Restore the fit before the last calibration; a second --undo takes that back."""

    def run(self) -> None:
        from app.compose import calibrate
        from app.drive import calibration as kept
        from app.drive.eye_routine import words_of_fit
        from encoder.eyes.routine import fit

        check_host(self.host, self.web)
        path = self.out or kept.profile_path()
        if [bool(self.eyes), self.session is not None, self.undo].count(True) != 1:
            raise InputError(
                "calibrate: expected one of --eyes, --session and --undo, got "
                f"{'several' if self.eyes or self.session else 'none'}; "
                "try livedrive calibrate --eyes uvc:0"
            )
        if self.web is not None and not self.eyes:
            raise InputError(
                "--web: expected --eyes, whose wearer it shows the targets; leave it away"
            )
        if self.undo:
            back = kept.undo(path)
            print(f"{path.resolve()} is as it was before" if back else "no calibration is in use")
            return
        kept.check_writable(path)
        session = self.session
        takes = (
            calibrate.takes_of_session(session)
            if session
            else calibrate.takes_of_cameras(self.eyes, self.web, self.host)
        )
        calibration, fits = fit(takes)
        for words in map(words_of_fit, fits):
            print(words)
        if not any(eye.followed for eye in fits):
            raise InputError(
                "calibrate: expected an eye that follows the targets, got none; nothing was "
                "written: look at each target until the next is named, and check the pictures "
                "with livedrive run"
            )
        kept.keep(calibration, path)
        print(f"wrote {path.resolve()}; next: livedrive run; back: livedrive calibrate --undo")
