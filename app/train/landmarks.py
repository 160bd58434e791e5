"""`livedrive train landmarks`: where the points of the detector of faces lie on the head."""

from pathlib import Path


def make_table(out: Path | None) -> None:
    """Draw the shipped people, find them, and write the table; takes some minutes.

    Raises InputError where the detector is not installed."""
    from render.avatars.maker import Maker
    from render.avatars.photos import places
    from render.avatars.photos.detector import FaceDetector
    from render.decoder import identity
    from render.splats.renderer import create_renderer

    detector, renderer = FaceDetector(), create_renderer()
    path = out / places.PATH.name if out else places.PATH
    places.save(places.make(Maker(), detector, renderer, identity.shipped()), path)
    renderer.close()
    print(f"wrote {path.resolve()}")
