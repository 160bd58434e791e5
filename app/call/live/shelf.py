"""Avatars received from partners: checked, private, kept for one call."""

import hashlib
import json
from collections.abc import Callable, Mapping
from pathlib import Path

from sensors import files
from sensors.types import InputError


class Shelf:
    """Files in a folder that is removed with the call."""

    def __init__(self, folder: Path, tell: Callable[[str], None]) -> None:
        self._folder, self._tell = folder, tell
        self._paths: dict[str, str] = {}  # by digest; empty: cannot be drawn

    def path(self, digest: str) -> str:
        """Path of the checked file; empty if there is none."""
        return self._paths.get(digest, "")

    def keep(self, received: Mapping[str, bytes]) -> None:
        """Write and check new files."""
        for digest, data in received.items():
            if digest not in self._paths:
                self._paths[digest] = self._checked(data)

    def _checked(self, data: bytes) -> str:
        from render.decoder import identity

        digest = hashlib.sha256(data).hexdigest()  # of what came: a name of our own
        path = self._folder / f"avatar_{digest[:16]}.safetensors"
        card = json.dumps({"kind": identity.KIND, "sha256": digest})
        try:
            files.write_bytes(path, data, private=True)
            files.write_text(path.with_suffix(".json"), card, private=True)
            identity.load(str(path))
        except (InputError, OSError) as error:
            self._tell(f"an avatar that was sent cannot be drawn: {error}")
            path.unlink(missing_ok=True)
            return ""
        return str(path)
