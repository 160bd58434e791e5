"""A person from photographs on the way to an avatar: progress, what was found."""

from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from render.avatars.maker import Maker
    from render.avatars.photos.person import PhotographedHead


def head(maker: "Maker", paths: tuple[Path, ...]) -> "PhotographedHead":
    """Raises InputError where the detector is not installed, there are too many photographs, or one
    is no picture, too small, or does not show one face."""
    from tqdm import tqdm

    from render.avatars.photos import person
    from render.avatars.photos.shape import picture
    from render.avatars.photos.shape.detector import FaceDetector

    with closing(FaceDetector()) as detector:
        photos = picture.load(paths, detector)
    with tqdm(total=100, unit="%", disable=None, leave=False) as bar:

        def show(stage: str, done: float) -> None:
            bar.set_description(stage)
            bar.update(round(100 * done) - bar.n)

        made = person.make(maker, photos, show)
    seen = "photograph" if len(photos) == 1 else f"{len(photos)} photographs"
    print(f"fitted {seen}: the face's points {made.left_mm:.1f} mm from where they are seen")
    hair = "no hair" if made.hair is None else "hair, whose colour that of --hair NAME gets"
    beard = "" if made.beard is None else "; a beard, whose colour that of --beard NAME gets"
    print(f"seen: eyes {made.eye}; {hair}{beard}")
    return made
