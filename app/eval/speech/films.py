"""`livedrive eval speech DATA --peers DIR --films DIR`: the paper's perceptual study, to vote on.

Ours and each twin say the same clips with the same face, gaze and sound; a page for each twin asks
which of the two is better, and `livedrive eval ab --count` adds up the votes.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from app.eval.speech.tables import OFFLINE, SYNTHESISED
from sensors.types import InputError

if TYPE_CHECKING:
    from app.eval.speech.evaluate import SpeechEvaluation

CLIPS = 24  # the paper's number, for each baseline
KINDS = ("freeform", "sentence")  # as many of each
SIZE_PX = 512
OURS = "ours"


def save(evaluated: "SpeechEvaluation", folder: Path, twins: dict[str, str]) -> list[Path]:
    """Write the films to folders in `folder` and a page beside them for each twin; returns the
    pages. twins: title of a row -> name of its folder. Raises InputError without a clip."""
    from tqdm import tqdm

    from app.eval.ab import make_page
    from app.sinks.video import film
    from encoder.capture.dataset import PACK_RATE
    from encoder.evaluation.rows import synthesised_gaze
    from render.cameras import portrait
    from render.decoder import identity
    from render.splats.renderer import create_renderer

    kinds = [evaluated.kinds[kind] for kind in KINDS if kind in evaluated.kinds]
    segments = [segment for kind in kinds for segment in kind[: CLIPS // len(KINDS)]]
    if not segments:
        raise InputError(
            f"--films: expected held-out clips of {' or '.join(KINDS)} in {evaluated.data}, got "
            "none; make them with livedrive capture"
        )
    seed, frames = evaluated.settings.seed, segments[0].frames.stop - segments[0].frames.start
    shown = synthesised_gaze(len(segments), frames, seed).numpy().reshape(-1, frames, 2, 3)
    who, renderer = identity.load(evaluated.settings.avatar), create_renderer()

    def pictures(
        codes: NDArray[np.float32], gaze: NDArray[np.float32]
    ) -> Iterator[NDArray[np.uint8]]:
        for code, look in zip(codes, gaze, strict=True):
            cloud = evaluated.decoder.decode(code, look, who, reuse=True)[1]
            renderer.draw(cloud, portrait(SIZE_PX, SIZE_PX))
            yield renderer.read_rgba()

    names = {(SYNTHESISED, "student"): OURS}
    names |= {(OFFLINE, title): name for title, name in twins.items()}
    for setting, title, row, _ in tqdm(evaluated.rows(segments), unit="row", disable=None):
        if (setting, title) not in names:
            continue
        place = folder / names[setting, title]
        place.mkdir(parents=True, exist_ok=True)
        for index, codes in enumerate(row(seed)):
            sound = (segments[index].audio * 32767).astype(np.int16)
            path = place / f"clip_{index:02d}.mp4"
            film(path, pictures(codes, shown[index]), sound, PACK_RATE)
    renderer.close()
    pages = [folder / f"{name}.html" for name in twins.values()]
    for page in pages:
        make_page(folder / OURS, page.with_suffix(""), page, seed)
    return pages
