"""What is known of a headset's eye cameras: how their pictures become two 400 x 400 views.

Flow: Shot -> EyeGeometry.views -> EyePacket. A typed profile for each known device, chosen by
`--eyes SPEC#profile=NAME`; `custom` is where a user starts: save it, change it, and name the file.
"""

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass, fields
from difflib import get_close_matches
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from sensors import files
from sensors.cameras.views import Views
from sensors.types import InputError

Items = tuple[Any, ...]

DARK, BRIGHT = 16, 240  # grey levels that exposure normalisation maps to
MIN_GAIN, MAX_GAIN = 0.5, 4.0  # a covered lens stays dark, so that its eye is not trusted


@dataclass(frozen=True, kw_only=True)
class EyeGeometry:
    """One device. The defaults are one camera that shows both eyes side by side, left first."""

    name: str = "custom"
    usb: str | None = None  # VENDOR:PRODUCT in hexadecimal, where the device has one
    side_by_side: bool = True  # False: one camera an eye, left first
    swap: bool = False  # the device has the eyes swapped
    turns: tuple[int, int] = (0, 0)  # quarter turns, counter-clockwise; left, right
    mirror: tuple[bool, bool] = (False, False)  # left to right, after turning
    crop: tuple[int, int, int, int] | None = None  # x, y, width, height in px of the whole picture
    exposure: bool = True  # normalise each view's brightness

    def views(
        self,
        image: NDArray[np.uint8],  # [H, W]
        camera: int = 0,  # of several: 0 left, 1 right
    ) -> list[tuple[int, NDArray[np.uint8]]]:
        """(eye, view [400, 400]) for each eye in a picture; the left eye is 0.

        Raises BadPictureError where the crop leaves too little of it.
        """
        shown = (0, 1) if self.side_by_side else (camera,)
        result: list[tuple[int, NDArray[np.uint8]]] = []
        for part in shown:
            eye = 1 - part if self.swap else part
            view = self._views(shown, eye).view(image, shown.index(part))
            result.append((eye, normalise_exposure(view) if self.exposure else view))
        return sorted(result, key=lambda pair: pair[0])

    def _views(self, shown: tuple[int, ...], eye: int) -> Views:
        return Views(eyes=shown, crop=self.crop, turns=self.turns[eye], mirror=self.mirror[eye])

    def save(self, path: Path) -> None:
        files.write_text(path, json.dumps(asdict(self), indent=1) + "\n", private=True)

    @staticmethod
    def load(path: Path) -> "EyeGeometry":
        """A profile that `save` wrote; anything else is an InputError of one line."""
        try:
            words = files.read_json(path)
        except (OSError, ValueError) as error:
            raise InputError(
                f"eye profile {path}: expected a JSON file, got {error}; save one, or name one of "
                f"{', '.join(PROFILES)}"
            ) from error
        return parse(words, str(path))


PROFILES: dict[str, EyeGeometry] = {
    geometry.name: geometry
    for geometry in (
        # 800 x 400, two views of 400 x 400
        EyeGeometry(name="bigscreen-beyond-2e", usb="35bd:0202"),
        # two OpenIris cameras, each with its own address
        EyeGeometry(name="eyetrackvr", side_by_side=False),
        # 400 x 400, two views of 200 x 400 that are stretched to squares
        EyeGeometry(name="vive-facial-tracker", usb="0bb4:0321"),
        EyeGeometry(name="custom"),
    )
}


def profile(name: str) -> EyeGeometry:
    """A known device by its name."""
    if name not in PROFILES:
        near = get_close_matches(name, PROFILES) or list(PROFILES)
        raise InputError(
            f"eye profile: expected one of {', '.join(PROFILES)}, got {name!r}; "
            f"try {near[0]}, or custom"
        )
    return PROFILES[name]


@dataclass(frozen=True, kw_only=True)
class ProfileViews(Views):
    """A profile as the views of one of its cameras."""

    geometry: EyeGeometry
    camera: int = 0

    def cut(
        self,
        image: NDArray[np.uint8],  # [H, W]
    ) -> list[tuple[int, NDArray[np.uint8]]]:
        return self.geometry.views(image, self.camera)


def views_of(geometry: EyeGeometry, eyes: tuple[int, ...]) -> ProfileViews:
    """Of the camera that shows `eyes`: both, or one of two cameras, left first."""
    if geometry.side_by_side != (len(eyes) == 2):
        expected = "one camera" if geometry.side_by_side else "two cameras, left and right"
        raise InputError(
            f"eye profile {geometry.name}: expected {expected}, got "
            f"{'one' if len(eyes) == 2 else 'two'}; give --eyes {expected}"
        )
    camera = 0 if geometry.side_by_side else eyes[0]
    shown = (1 - camera,) if geometry.swap and not geometry.side_by_side else eyes
    return ProfileViews(eyes=shown, geometry=geometry, camera=camera)


def parse(words: object, where: str) -> EyeGeometry:
    """JSON values -> profile; names the key that is wrong and the nearest right one."""
    names = [field.name for field in fields(EyeGeometry)]
    if not isinstance(words, dict):
        raise InputError(f"eye profile {where}: expected an object, got {type(words).__name__}")
    values: dict[str, object] = {}
    for key, value in words.items():  # pyright: ignore[reportUnknownVariableType]
        if key not in names:
            near = get_close_matches(str(key), names) or names  # pyright: ignore[reportUnknownArgumentType]
            raise InputError(
                f"eye profile {where}: expected keys like {near[0]}, got {key!r}; correct the file"
            )
        values[str(key)] = tuple(value) if isinstance(value, list) else value  # pyright: ignore
    _check(values, where)
    return EyeGeometry(**values)  # pyright: ignore[reportArgumentType]


def _check(values: dict[str, object], where: str) -> None:
    def is_pair(value: Any, of: type) -> bool:
        return isinstance(value, tuple) and [type(v) for v in cast(Items, value)] == [of, of]

    def is_crop(value: Any) -> bool:
        if not isinstance(value, tuple):
            return value is None
        numbers = cast(Items, value)
        return len(numbers) == 4 and all(type(v) is int and v >= 0 for v in numbers)

    rules: dict[str, tuple[str, Callable[[Any], bool]]] = {
        "name": ("a name", lambda v: isinstance(v, str)),
        "usb": ("VENDOR:PRODUCT or null", lambda v: v is None or isinstance(v, str)),
        "side_by_side": ("true or false", lambda v: isinstance(v, bool)),
        "swap": ("true or false", lambda v: isinstance(v, bool)),
        "turns": ("two whole numbers", lambda v: is_pair(v, int)),
        "mirror": ("two of true and false", lambda v: is_pair(v, bool)),
        "crop": ("null or four whole numbers", is_crop),
        "exposure": ("true or false", lambda v: isinstance(v, bool)),
    }
    for key, value in values.items():
        expected, holds = rules[key]
        if not holds(value):
            raise InputError(
                f"eye profile {where}: expected {expected} for {key}, got {value!r}; "
                "correct the file"
            )


def normalise_exposure(
    view: NDArray[np.uint8],  # [H, W]
) -> NDArray[np.uint8]:
    """Stretch the 2nd to 98th percentile to DARK..BRIGHT; a function of this picture alone."""
    dark, bright = np.percentile(view[::4, ::4], (2, 98))
    gain = np.clip((BRIGHT - DARK) / max(float(bright - dark), 1.0), MIN_GAIN, MAX_GAIN)
    centre = 0.5 * (dark + bright)
    # never brighter than the gain makes it: what is black stays black
    target = min(0.5 * (DARK + BRIGHT), float(gain) * float(centre))
    levels = target + gain * (np.arange(256) - centre)
    return np.take(levels.clip(0, 255).astype(np.uint8), view)
