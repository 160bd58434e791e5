"""The token of the page for other devices: made on first use, the same at every start.

A headset keeps its bookmark and its cookie. It lies in the user's settings, readable by its owner
alone; to withdraw it, delete the file.
"""

import re
import secrets
from pathlib import Path

from sensors import files
from sensors.types import InputError

TOKEN_FILE = "web_token"
PATTERN = re.compile(r"[\w-]{20,64}")  # url-safe


def ensure(folder: Path) -> str:
    """The token of this folder of settings."""
    path = folder / TOKEN_FILE
    if files.check_regular(path).exists():
        token = files.read_bytes(path).decode("ascii", "replace").strip()
        if PATTERN.fullmatch(token):
            return token
        raise InputError(
            f"web: expected 20 to 64 url-safe characters in {path}, got something else; delete it, "
            "and a new one is made"
        )
    token = secrets.token_urlsafe(16)
    folder.mkdir(parents=True, exist_ok=True)
    files.write_text(path, token + "\n", private=True)
    return token
