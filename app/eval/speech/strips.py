"""`livedrive eval speech DATA --leave-one-out --mocap DIR --strips DIR`: mouths at named phones.

A strip is one voice: what the avatar shows at the middle of a phone, and below it the same avatar
moved by the tracked curves of the same frame, which know little of lips' width and nothing of the
tongue. Talkers that were left out come first; others are driven by the student of --weights, which
may know their voice. A phone is the one of median length among its kind: the longest are
often misaligned.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from app.eval.speech.following import (
    Followed,
    drivers_of,
    followed,
    tracked_folder,
    tracked_takes,
)
from sensors import files
from sensors.types import FPS

if TYPE_CHECKING:
    from app.eval.speech.settings import SpeechSettings
    from encoder.driver import Driver

Pixels = NDArray[np.uint8]
KINDS: dict[str, tuple[str, ...]] = {  # column -> phones that may stand in it, the best first
    "m": ("m", "b", "p"),
    "f": ("f", "v"),
    "th": ("th", "dh"),
    "s": ("s", "z"),
    "sh": ("sh", "ch", "jh", "zh"),
    "w": ("w",),
    "a": ("aa", "ae", "ay", "ah", "aw"),
    "i": ("iy", "ih"),
    "o": ("ow", "ao"),
    "u": ("uw", "uh"),
}
VOICES = 8
CLIPS = 20  # of a talker, at most: the last, which are for tests in a folder of one
SIZE_PX, WIDTH_PX, HEIGHT_PX = 1024, 300, 240  # of a portrait, and of the mouth in it
LABEL_PX = 36


class MouthShot(NamedTuple):
    """One frame: phone, and codes [256] shown and tracked."""

    phone: str
    shown: NDArray[np.float32]
    tracked: NDArray[np.float32]


def shots(clips: Sequence[Followed]) -> list[MouthShot | None]:
    """For each column the phone of median length, at its middle, of the best kind that is said;
    None: none is."""
    found = list[MouthShot | None]()
    for names in KINDS.values():
        said = [
            (names.index(phone.name), phone.end - phone.start, number, phone)
            for number, clip in enumerate(clips)
            for phone in clip.phones
            if phone.name in names and phone.end <= len(clip.shown) / FPS
        ]
        if not said:
            found.append(None)
            continue
        first = min(row[0] for row in said)
        best = sorted((row for row in said if row[0] == first), key=lambda row: row[:3])
        _, _, number, phone = best[len(best) // 2]
        row = max(round((phone.start + phone.end) / 2 * FPS) - 1, 0)
        found.append(MouthShot(phone.name, clips[number].shown[row], clips[number].tracked[row]))
    return found


def evaluate(data: Path, settings: "SpeechSettings") -> None:
    """Write VOICE.jpg for each voice and strips.jpg with all of them."""
    from tqdm import tqdm

    assert settings.strips is not None
    folder = tracked_folder(settings.mocap)
    voices = _voices(folder, drivers_of(data, settings.weights), settings.weights)
    settings.strips.mkdir(parents=True, exist_ok=True)
    draw = _painter(settings.avatar)
    strips = list[Pixels]()
    for name, clips in tqdm(voices, total=VOICES, unit="voice", disable=None):
        strips.append(strip(name, shots(clips), draw))
        _save(settings.strips / f"{name.split()[0]}.jpg", strips[-1])
    path = settings.strips / "strips.jpg"
    _save(path, np.concatenate(strips), 2)
    print(f"wrote {path}, and one picture for each of {len(strips)} voices")


def _voices(
    folder: Path, drivers: "dict[str, Driver]", weights: Path | None
) -> Iterator[tuple[str, list[Followed]]]:
    """Talker's name, and whether the student knows it, with its clips."""
    from encoder.capture.subjects.mocap import grid_speakers
    from encoder.inference import load_driver

    every = [f"grid-{s}" for part in sorted(folder.glob("*/labels.npz"))
             for s in grid_speakers(part.parent)]  # fmt: skip
    known = load_driver(weights, "cpu")
    names = sorted(dict.fromkeys(every), key=lambda name: (name not in drivers, name))
    for name in names[:VOICES]:
        takes = list(tracked_takes(folder, name, CLIPS))
        title = name if name in drivers else f"{name} (a voice it has learned from)"
        yield title, followed(drivers.get(name, known), takes)


def _painter(avatar: str) -> Any:
    """code [256] -> [HEIGHT_PX, WIDTH_PX, 3], the mouth of an avatar."""
    from render.cameras import portrait
    from render.decoder import identity
    from render.decoder.decoder import Decoder
    from render.splats.renderer import create_renderer
    from render.types import AHEAD

    decoder, who, renderer = Decoder.load(), identity.load(avatar), create_renderer()
    x, y, z = who.geometry[decoder.regions["lips"]].mean(0).tolist()
    camera = portrait(SIZE_PX, SIZE_PX, target_mm=(x, y, z - 90))
    top, left = (SIZE_PX - HEIGHT_PX) // 2, (SIZE_PX - WIDTH_PX) // 2

    def draw(code: NDArray[np.float32]) -> Pixels:
        cloud = decoder.decode(code.astype(np.float32), AHEAD, who, reuse=True)[1]
        renderer.draw(cloud, camera)
        return renderer.read_rgba()[top : top + HEIGHT_PX, left : left + WIDTH_PX, :3].copy()

    return draw


def strip(title: str, row: Sequence[MouthShot | None], draw: Any) -> Pixels:
    """Two rows of mouths, shown above tracked, a label under each column and the title in front."""
    from PIL import Image, ImageDraw, ImageFont

    page = Image.new("RGB", (WIDTH_PX * len(row), 2 * HEIGHT_PX + 2 * LABEL_PX), "white")
    pen, font = ImageDraw.Draw(page), ImageFont.load_default(26)
    pen.text((8, 2), f"{title}: shown, and below it tracked", "black", font)
    for column, shot in enumerate(row):
        left = column * WIDTH_PX
        if shot is None:
            continue
        for line, code in enumerate((shot.shown, shot.tracked)):
            page.paste(Image.fromarray(draw(code)), (left, LABEL_PX + line * HEIGHT_PX))
        where = (left + WIDTH_PX // 2, page.height - LABEL_PX // 2)
        pen.text(where, shot.phone, "black", font, anchor="mm")
    return np.asarray(page)


def _save(path: Path, pixels: Pixels, times: int = 1) -> None:
    """Write a JPEG, so many times smaller."""
    from PIL import Image

    with files.replacing(path) as draft:
        Image.fromarray(pixels).reduce(times).save(draft, quality=66)
