"""LiveRecorder: a session written beside a live run that must not wait for a disk.

Flow: drive | record -> LiveRecorder.append -> queue -> thread -> RecordingWriter. A full or broken
disk stops the recording with one clear line; driving goes on. Sound of more than 4 GiB goes on in
another session beside the first.
"""

import queue
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from sensors.session.format import free_beside
from sensors.session.recording import RecordingWriter
from sensors.types import EmotionPacket, InputError, Packet

MAX_WAITING = 1024  # packets; about 6 s of sound and both eyes
JOIN_S = 30.0


class LiveRecorder:
    """Appends packets in the background until it is closed or fails."""

    def __init__(
        self,
        folder: Path,
        *,
        created: str,
        devices: Mapping[str, str],
        tell: Callable[[str], None],  # called with one line of text
        calibration: Mapping[str, Any] | None = None,
        alone: bool = False,  # nothing is driven beside it
    ) -> None:
        """Raises InputError where the folder holds something already."""
        self.problem = ""  # why nothing is recorded any more
        self._folder, self._tell = folder, tell
        self._beside = "" if alone else "driving goes on, "
        self._words: dict[str, Any] = {
            "created": created,
            "devices": devices,
            "calibration": calibration,
        }
        self._emotion: EmotionPacket | None = None  # written at the start of a continued session
        self._queue: queue.Queue[Packet | None] = queue.Queue(MAX_WAITING)
        self._thread: threading.Thread | None = None
        try:
            self._writer = RecordingWriter(folder, **self._words)
        except InputError:
            raise
        except OSError as error:
            self.problem = f"{error.strerror or error}"
            tell(
                f"{folder}: expected to begin recording, got: {self.problem}; "
                f"{self._beside}choose another"
            )
            return
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)
        self._thread.start()

    def append(self, packet: Packet) -> None:
        """Hand over a packet; never waits."""
        if self.problem:
            return
        try:
            self._queue.put_nowait(packet)
        except queue.Full:
            self._stop("the disk is too slow")

    def close(self) -> None:
        """Write what is waiting and finish the session; a disk that hangs is waited for so long."""
        if self._thread is not None:
            with suppress(queue.Full):
                self._queue.put(None, timeout=JOIN_S)
                self._thread.join(JOIN_S)
            if self._thread.is_alive():
                self._stop("the disk does not answer")
            self._thread = None

    def _run(self) -> None:
        from av import error as av_error

        def succeeds(act: Callable[..., None], *given: Any, **words: Any) -> bool:
            try:
                act(*given, **words)
            except (OSError, av_error.FFmpegError, InputError) as error:
                self._stop(getattr(error, "strerror", None) or str(error))
                return False
            return True

        whole = True
        for packet in iter(self._queue.get, None):
            if not self.problem:
                whole = succeeds(self._append, packet)
        succeeds(self._writer.close, whole=whole)

    def _append(self, packet: Packet) -> None:
        if isinstance(packet, EmotionPacket):
            self._emotion = packet
        if not self._writer.has_room(packet):
            self._writer.close()
            folder = free_beside(self._folder)
            self._tell(f"{self._writer.folder} is full (4 GiB of sound): going on in {folder}")
            self._writer = RecordingWriter(folder, **self._words)
            if self._emotion:
                self._writer.append(EmotionPacket(packet.t_ns, self._emotion.words))
        self._writer.append(packet)

    def _stop(self, reason: str) -> None:
        if not self.problem:
            self.problem = reason
            self._tell(
                f"{self._folder}: expected to go on recording, got: {reason}; "
                f"{self._beside}what was recorded is kept"
            )
