"""The user's folders for settings, data and cache, as XDG, Windows and macOS define them."""

from pathlib import Path

import platformdirs

NAME = "livedrive"


def config() -> Path:
    """Calibrations, certificates and keys."""
    return platformdirs.user_config_path(NAME, appauthor=False)


def data() -> Path:
    """The user's avatars."""
    return platformdirs.user_data_path(NAME, appauthor=False)


def cache() -> Path:
    """Files that can be computed again."""
    return platformdirs.user_cache_path(NAME, appauthor=False)
