"""Golden pictures of the synthetic head: `python tests/render/golden.py` blesses them anew.

The rasteriser is part of the picture, so only llvmpipe may bless, and only from a clean tree.
"""

import hashlib
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "tests" / "golden"
MANIFEST = FOLDER / "render.json"
NAMES = {"head_front": 0.0, "head_left": 35.0}  # picture -> yaw of the camera, degrees


def render_all(renderer) -> dict[str, NDArray[np.uint8]]:
    """Every golden picture, drawn now: [160, 160, 3]."""
    from scenes import head_scene

    from render.cameras import portrait

    pictures = {}
    for name, yaw_deg in NAMES.items():
        renderer.draw(head_scene(4000), portrait(160, 160, yaw_deg=yaw_deg))
        pictures[name] = renderer.read_rgba()[..., :3].copy()
    return pictures


def bless() -> None:
    """Write the pictures and the manifest."""
    from PIL import Image

    from render.renderer import create_renderer

    def git(*words: str) -> str:
        return subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True).stdout

    if git("status", "--porcelain", "--untracked-files=no", "--", "render", "tests/render"):
        sys.exit("golden: expected a clean tree in render and tests/render; commit first")
    renderer = create_renderer("egl", "tiles")
    if "llvmpipe" not in renderer.name:
        sys.exit(f"golden: expected llvmpipe, got {renderer.name}")
    FOLDER.mkdir(exist_ok=True)
    digests = {}
    for name, picture in render_all(renderer).items():
        Image.fromarray(picture).save(FOLDER / f"{name}.png", optimize=True)
        digests[name] = hashlib.sha256(picture.tobytes()).hexdigest()
    manifest = {
        "renderer": renderer.name,
        "commit": git("rev-parse", "HEAD").strip(),
        "sha256_of_pixels": digests,
    }
    MANIFEST.write_text(json.dumps(manifest, indent=1) + "\n")
    renderer.close()


if __name__ == "__main__":
    sys.path.insert(0, str(ROOT))
    bless()
