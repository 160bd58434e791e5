"""Pictures of the avatars and of the synthetic head against those kept in tests/golden."""

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest
from golden import (
    AVATARS,
    EXPRESSIONS,
    FOLDER,
    HEADS,
    MANIFEST,
    VIEWS,
    bless,
    digest,
    kept,
    mismatch,
)
from golden import render_all as draw_all

from render.splats.renderer import wrap_context


@pytest.fixture(scope="module")
def pictures(egl_context, decoder):
    return draw_all(wrap_context(egl_context, "tiles"), decoder)


@pytest.mark.slow
def test_quads_draw_the_golden_pictures(egl_context, decoder):
    pictures = draw_all(wrap_context(egl_context, "quads"), decoder)
    wrong = [text for name, picture in pictures.items() if (text := mismatch(name, picture))]
    assert not wrong, "\n".join(wrong)


def test_pictures_equal_the_golden_ones(pictures, egl_context, decoder, pytestconfig):
    if pytestconfig.getoption("--update-golden"):
        bless(wrap_context(egl_context, "tiles"), decoder)
    wrong = [text for name, picture in pictures.items() if (text := mismatch(name, picture))]
    assert not wrong, "\n".join(wrong)


def test_manifest_belongs_to_the_pictures(pictures):
    manifest = json.loads(MANIFEST.read_text())
    assert "llvmpipe" in manifest["renderer"] and len(manifest["commit"]) == 40
    assert len(pictures) == (len(AVATARS) * len(EXPRESSIONS) + len(HEADS) + 1) * len(VIEWS)
    assert manifest["sha256_of_pixels"] == {name: digest(kept(name)) for name in pictures}
    assert {path.stem for path in FOLDER.glob("*.png")} == set(pictures)


def test_expressions_and_avatars_differ(pictures):
    """A golden picture that shows nothing would never fail."""
    names = [name for name in pictures if not name.startswith("head")]
    for k, one in enumerate(names):
        assert pictures[one].std() > 8  # a flat picture has 0
        for other in names[k + 1 :]:
            difference = np.abs(pictures[one].astype(int) - pictures[other])
            assert np.count_nonzero(difference > 12) > 300, (one, other)


def test_a_changed_picture_is_found_and_shown(pictures, tmp_path: Path):
    name = f"{AVATARS[0]}_rest_front"
    changed = kept(name).copy()
    assert mismatch(name, changed, tmp_path) == "" and not list(tmp_path.iterdir())
    changed[60:70, 60:70] = 0
    assert "dB" in mismatch(name, changed, tmp_path)
    from PIL import Image

    assert Image.open(tmp_path / f"golden_{name}.png").size == (480, 160)
    assert "expected (160, 160, 3)" in mismatch(name, changed[:80], tmp_path)


def test_a_dirty_tree_blesses_nothing(tiles, decoder, tmp_path: Path):
    (tmp_path / "render").mkdir()
    (tmp_path / "render" / "new.py").touch()
    subprocess.run(["git", "init", "-q", str(tmp_path)], check=True)
    before = MANIFEST.read_bytes()
    with pytest.raises(pytest.exit.Exception, match="clean tree"):
        bless(tiles, decoder, tmp_path)
    assert MANIFEST.read_bytes() == before
