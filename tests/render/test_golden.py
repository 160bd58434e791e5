"""Pictures of the synthetic head against those kept in tests/golden."""

import hashlib
import json

import numpy as np
from golden import FOLDER, MANIFEST, NAMES, render_all
from PIL import Image
from scenes import psnr_db


def test_pictures_equal_the_golden_ones(tiles, tmp_path):
    for name, picture in render_all(tiles).items():
        kept = np.asarray(Image.open(FOLDER / f"{name}.png"))
        difference = np.abs(picture.astype(int) - kept)
        if psnr_db(picture, kept) < 55.0:
            Image.fromarray(picture).save(tmp_path / f"{name}_actual.png")
            Image.fromarray(difference.astype(np.uint8)).save(tmp_path / f"{name}_diff.png")
            amplified = (20 * difference).clip(0, 255).astype(np.uint8)
            Image.fromarray(amplified).save(tmp_path / f"{name}_diff_x20.png")
            raise AssertionError(f"{name}: {psnr_db(picture, kept):.1f} dB, see {tmp_path}")


def test_manifest_belongs_to_the_pictures():
    manifest = json.loads(MANIFEST.read_text())
    assert "llvmpipe" in manifest["renderer"] and len(manifest["commit"]) == 40
    for name in NAMES:
        pixels = np.asarray(Image.open(FOLDER / f"{name}.png")).tobytes()
        assert manifest["sha256_of_pixels"][name] == hashlib.sha256(pixels).hexdigest()
