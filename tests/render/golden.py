"""Golden pictures: three avatars, four expressions, two views; turned heads; the synthetic head.

`make golden` blesses them anew. The rasteriser is part of
the picture, so only llvmpipe may bless, and only from a clean tree.
"""

import hashlib
import json
import math
import subprocess
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scenes import psnr_db

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "tests" / "golden"
MANIFEST = FOLDER / "render.json"
FAILURES = ROOT / "tests" / "failures"  # git-ignored
SIZE = 160
AVATARS = ("ada", "ben", "kofi")
VIEWS = {"front": 0.0, "left": 35.0}  # yaw of the camera, degrees
# Rig activations and the point both eyes look at, as yaw and pitch in degrees.
EXPRESSIONS: dict[str, tuple[dict[str, float], tuple[float, float]]] = {
    "rest": ({}, (0.0, 0.0)),
    "smile": ({"mouthSmile_L": 0.9, "mouthSmile_R": 0.9, "cheekSquint_L": 0.4}, (10.0, 0.0)),
    "open": ({"jawOpen": 0.8, "browInnerUp_L": 0.9, "browInnerUp_R": 0.9}, (0.0, 12.0)),
    "pucker": ({"mouthPucker": 0.9, "eyeBlink_L": 1.0, "eyeBlink_R": 1.0}, (0.0, 0.0)),
}
# Pitch, yaw and roll of the head, degrees.
HEADS = {"yaw_left": (0, 30, 0), "yaw_right": (0, -30, 0), "down": (20, 0, 0), "up": (-20, 0, 0)}
HEADS |= {"roll_left": (0, 0, -15), "roll_right": (0, 0, 15)}
MIN_DB = 55.0
Picture = NDArray[np.uint8]  # [160, 160, 3]


def render_all(renderer, decoder) -> dict[str, Picture]:
    """Every golden picture, drawn now, by name."""
    from scenes import head_scene

    from render.cameras import portrait
    from render.decoder import identity
    from render.types import AHEAD
    from sensors import rotation
    from sensors.types import HeadPose

    pictures = {}

    def draw(name: str, gaussians) -> None:
        for view, yaw_deg in VIEWS.items():
            renderer.draw(gaussians, portrait(SIZE, SIZE, yaw_deg=yaw_deg))
            pictures[f"{name}_{view}"] = renderer.read_rgba()[..., :3].copy()

    draw("head", head_scene(4000))
    for avatar in AVATARS:
        who = identity.load(avatar)
        for name, (activations, look) in EXPRESSIONS.items():
            rig = np.zeros(len(decoder.rig_names), np.float32)
            for channel, value in activations.items():
                rig[decoder.rig_names.index(channel)] = value
            yaw, pitch = np.radians(look)
            ahead = np.sin(yaw) * np.cos(pitch), np.sin(pitch), np.cos(yaw) * np.cos(pitch)
            gaze = np.tile(np.array(ahead, np.float32), (2, 1))
            draw(f"{avatar}_{name}", decoder.decode(decoder.encode(rig), gaze, who)[1])
    who = identity.load("ben")
    for name, (pitch, yaw, roll) in HEADS.items():
        turn = rotation.from_angles((math.radians(pitch), math.radians(yaw), math.radians(roll)))
        head = HeadPose(quat=turn)
        draw(f"ben_{name}", decoder.decode(np.zeros(256, np.float32), AHEAD, who, head)[1])
    return pictures


def kept(name: str) -> Picture:
    """The golden picture of this name."""
    from PIL import Image

    return np.asarray(Image.open(FOLDER / f"{name}.png"))


def mismatch(name: str, picture: Picture, folder: Path = FAILURES) -> str:
    """Empty, or what is wrong; then `folder` has expected, actual and amplified difference side
    by side in one picture."""
    from PIL import Image

    expected = kept(name)
    if picture.shape == expected.shape and psnr_db(picture, expected) >= MIN_DB:
        return ""
    folder.mkdir(exist_ok=True)
    path = folder / f"golden_{name}.png"
    parts = [expected, picture]
    text = f"{name}: expected {expected.shape}, got {picture.shape}"
    if picture.shape == expected.shape:
        difference = np.abs(picture.astype(int) - expected)
        parts.append((20 * difference).clip(0, 255).astype(np.uint8))
        text = f"{name}: {psnr_db(picture, expected):.1f} dB, largest error {difference.max()}/255"
        Image.fromarray(np.concatenate(parts, axis=1)).save(path)
    return f"{text}, see {path}"


def bless(renderer, decoder, root: Path = ROOT) -> None:
    """Write the pictures and the manifest."""
    from PIL import Image

    def git(*words: str) -> str:
        return subprocess.run(["git", *words], cwd=root, capture_output=True, text=True).stdout

    dirty = git("status", "--porcelain", "--", "render", "tests/render").splitlines()
    if dirty:
        pytest.exit(
            f"--update-golden: expected a clean tree in render and tests/render, got "
            f"{len(dirty)} changed files ({dirty[0].strip()}); commit first",
            returncode=2,
        )
    if "llvmpipe" not in renderer.name:
        pytest.exit(f"--update-golden: expected llvmpipe, got {renderer.name}", returncode=2)
    FOLDER.mkdir(exist_ok=True)
    for old in FOLDER.glob("*.png"):
        old.unlink()
    digests = {}
    for name, picture in render_all(renderer, decoder).items():
        Image.fromarray(picture).save(FOLDER / f"{name}.png", optimize=True)
        digests[name] = digest(picture)
    manifest = {
        "renderer": renderer.name,
        "commit": git("rev-parse", "HEAD").strip(),
        "sha256_of_pixels": digests,
    }
    MANIFEST.write_text(json.dumps(manifest, indent=1) + "\n")


def digest(picture: Picture) -> str:
    return hashlib.sha256(picture.tobytes()).hexdigest()
