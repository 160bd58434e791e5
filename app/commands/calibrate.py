"""`livedrive calibrate`: ten seconds in which the eyes are told apart from the average."""

from dataclasses import dataclass
from typing import Annotated

import tyro

from app.terminal.arguments import File
from sensors.types import InputError


@dataclass(kw_only=True)
class Calibrate:
    """Look at five points, blink and close: fits gaze and lids to you; `run` then uses it.

    What was fitted before is kept beside it; --undo takes it back.
    """

    eyes: Annotated[tuple[str, ...], tyro.conf.arg(metavar="SPEC ...")] = ()
    """Cameras, as for livedrive run."""
    session: File = None
    """Instead of cameras: a session recorded while following the targets."""
    out: File = None
    """File to write; default: your profile."""
    undo: bool = False
    """Go back to what was before the last calibration; once more: forward again."""

    def run(self) -> None:
        from app.compose import calibrate
        from app.drive import calibration as kept
        from app.drive.eye_routine import words_of_fit
        from encoder.eyes.routine import fit

        path = self.out or kept.profile_path()
        if [bool(self.eyes), self.session is not None, self.undo].count(True) != 1:
            raise InputError(
                "calibrate: expected one of --eyes, --session and --undo, got "
                f"{'several' if self.eyes or self.session else 'none'}; "
                "try livedrive calibrate --eyes uvc:0"
            )
        if self.undo:
            back = kept.undo(path)
            print(f"{path.resolve()} is as it was before" if back else "no calibration is used")
            return
        session = self.session
        takes = (
            calibrate.takes_of_session(session)
            if session
            else calibrate.takes_of_cameras(self.eyes)
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
