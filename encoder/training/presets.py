"""A stage's settings: the defaults of its config, changed by a preset, changed by the user."""

from collections.abc import Mapping
from typing import Any, Generic, TypeVar

from sensors.types import InputError

Config = TypeVar("Config")


class Presets(Generic[Config]):
    """Named settings of a config dataclass; calling it makes a config of one of them."""

    def __init__(self, config: type[Config], named: Mapping[str, Mapping[str, Any]]) -> None:
        self.config, self.named = config, named

    def __call__(self, name: str, **settings: Any) -> Config:
        """The preset's config; `settings` are the user's and win over it."""
        if name not in self.named:
            known = ", ".join(self.named)
            raise InputError(f"--preset: expected one of {known}, got {name!r}; choose one of them")
        return self.config(**{**self.named[name], **settings})
