"""`livedrive capture inspect DIR --picture p.png`: one clip as a person would judge it.

Waveform, spectrogram with its phones, main curves, eye pictures, and eight renders of the face.
With --video it also writes the clip as a film with sound.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from app.terminal import figures
from sensors.types import FPS, InputError

if TYPE_CHECKING:
    from encoder.capture.dataset import Clip

NUM_FACES = 8
FACE_PX = 300
MAX_FRAMES = 7 * FPS
CURVES = ("jawOpen", "mouthClose", "mouthPucker", "mouthRollLower", "eyeBlink_L", "browInnerUp_L")


@dataclass(frozen=True, kw_only=True)
class InspectSettings:
    picture: Path  # PNG to write
    video: Path | None = None  # also write the whole clip
    subject: str | None = None  # default: the first
    clip: int = 0  # of that subject
    avatar: str = "ben"
    seed: int = 0


def inspect(folder: Path, settings: InspectSettings) -> None:
    """Draw the picture; raise InputError for an unknown subject or clip."""
    clip = _choose(folder, settings)
    faces, shown = _ClipRenderer(settings.avatar), _beginning(clip)
    said = np.flatnonzero(shown.phones != 0)
    frames = said if len(said) >= NUM_FACES else np.arange(shown.num_frames)
    frames = frames[np.linspace(0, len(frames) - 1, NUM_FACES + 2).astype(int)[1:-1]]
    renders = [faces.draw(shown, int(t)) for t in frames]
    eyes = _eyes(shown, frames[::2], settings)
    _sheet(shown, frames, renders, eyes, settings.picture)
    print(f"wrote {settings.picture.resolve()}")
    if settings.video:
        _film(clip, faces, settings.video)
        print(f"wrote {settings.video.resolve()}")


def _choose(folder: Path, settings: InspectSettings) -> "Clip":
    from encoder.capture import dataset

    names = [shard["file"] for shard in dataset.read_manifest(folder)["shards"]]
    name = settings.subject or names[0]
    if name not in names:
        near = [n for n in names if n[:4] == name[:4]] or names
        raise InputError(
            f"capture inspect: expected a subject such as {', '.join(near[:4])}, got {name!r}; "
            "pass --subject"
        )
    clips = list(dataset.read_shard(folder / name))
    if not 0 <= settings.clip < len(clips):
        raise InputError(
            f"capture inspect: expected a clip 0-{len(clips) - 1} of {name}, got {settings.clip}; "
            "pass --clip"
        )
    return clips[settings.clip]


def _beginning(clip: "Clip") -> "Clip":
    """The first seconds of a clip, so that phones can be read."""
    from encoder.capture.dataset import PACK_SAMPLES_PER_FRAME

    frames = min(clip.num_frames, MAX_FRAMES)
    return replace(
        clip,
        audio=clip.audio[: frames * PACK_SAMPLES_PER_FRAME],
        rig=clip.rig[:frames],
        gaze=clip.gaze[:frames],
        phones=clip.phones[:frames],
        spans=clip.spans[clip.spans[:, 1] < frames / FPS],
    )


class _ClipRenderer:
    """Renders of one avatar saying a clip."""

    def __init__(self, avatar: str) -> None:
        from render.cameras import portrait
        from render.decoder import identity
        from render.decoder.decoder import Decoder
        from render.splats.renderer import create_renderer

        self.decoder, self.who = Decoder.load(), identity.load(avatar)
        self.renderer, self.camera = create_renderer(), portrait(FACE_PX, FACE_PX)

    def draw(self, clip: "Clip", t: int) -> NDArray[np.uint8]:
        """[H, W, 3] of frame t."""
        code = self.decoder.encode(clip.rig[t].astype(np.float32))
        _, cloud = self.decoder.decode(code, clip.gaze[t].astype(np.float32), self.who)
        self.renderer.draw(cloud, self.camera)
        return self.renderer.read_rgba()[..., :3].copy()


def _eyes(clip: "Clip", frames: NDArray[Any], settings: InspectSettings) -> list[NDArray[np.uint8]]:
    """Pairs side by side [400, 800] at some frames."""
    from render.decoder import identity
    from render.decoder.decoder import Decoder
    from render.near_eye.camera import NearEye
    from render.near_eye.look import Look

    rng = np.random.default_rng(settings.seed)
    near = NearEye(Decoder.load())
    wearer = near.wear(identity.load(settings.avatar), Look.draw(rng), rng)
    pairs = [
        near.draw(wearer, clip.rig[t].astype(np.float32), clip.gaze[t].astype(np.float32), rng)
        for t in frames
    ]
    near.close()
    return [np.concatenate([pair.pictures[1], pair.pictures[0]], 1) for pair in pairs]


def _sheet(
    clip: "Clip",
    frames: NDArray[Any],
    faces: list[NDArray[np.uint8]],
    eyes: list[NDArray[np.uint8]],
    path: Path,
) -> None:
    from encoder.capture.dataset import PACK_RATE
    from encoder.capture.motion.channels import RIG_INDEX
    from encoder.capture.speech.phones import PHONES

    figure = figures.figure(16, 13)
    grid = figure.add_gridspec(5, 8, height_ratios=(1, 2, 2, 2.2, 2.2))
    sound = np.asarray(clip.audio, np.float32) / 32768
    seconds = len(sound) / PACK_RATE
    wave, spectrum, curves = (figure.add_subplot(grid[row, :]) for row in range(3))
    wave.plot(np.arange(len(sound)) / PACK_RATE, sound, linewidth=0.4)
    label = f"{clip.voice} ({clip.truth}, {clip.emotion}, {clip.split}): {clip.text}"
    wave.set(xlim=(0, seconds), title=label[:150])
    quiet = 1e-5 * np.random.default_rng(0).standard_normal(len(sound))  # no log of nothing
    spectrum.specgram(sound + quiet, NFFT=512, Fs=PACK_RATE, noverlap=384, vmin=-140)
    spectrum.set(xlim=(0, seconds), ylim=(0, 8000), ylabel="Hz")
    for index, start, end in clip.spans:
        spectrum.axvline(start, color="w", linewidth=0.4)
        if index > 0:
            spectrum.text((start + end) / 2, 7300, PHONES[int(index)], ha="center", color="w")
    times = (np.arange(clip.num_frames) + 1) / FPS
    for name in CURVES:
        curves.plot(times, clip.rig[:, RIG_INDEX[name]], label=name)
    for t in frames:
        curves.axvline(times[t], color="0.7", linewidth=0.8)
    curves.set(xlim=(0, seconds), ylim=(0, 1), ylabel="rig")
    curves.legend(loc="upper right", ncols=len(CURVES))
    for k, (t, face) in enumerate(zip(frames, faces, strict=True)):
        axis = figure.add_subplot(grid[3, k])
        axis.imshow(face)
        axis.set(title=f"{times[t]:.2f} s {PHONES[max(int(clip.phones[t]), 0)]}")
        axis.axis("off")
    for k, pair in enumerate(eyes):
        axis = figure.add_subplot(grid[4, 2 * k : 2 * k + 2])
        axis.imshow(pair, cmap="gray", vmin=0, vmax=255)
        axis.axis("off")
    figures.save(figure, path, dpi=80)


def _film(clip: "Clip", faces: _ClipRenderer, path: Path) -> None:
    """The clip as a video with its sound."""
    from tqdm import tqdm

    from app.sinks.video import film
    from encoder.capture.dataset import PACK_RATE

    frames = tqdm(range(clip.num_frames), unit="frame", desc="film")
    film(path, (faces.draw(clip, t) for t in frames), np.asarray(clip.audio), PACK_RATE)
