"""Stages of `livedrive train prior` that need no face data: stopped, they go on where they were."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from scipy.sparse import csr_array

from render.avatars import textures
from render.decoder.learned import atlas, networks
from render.lighting import developed
from render.training import prior
from render.training.fitting import fit, learn
from render.training.fitting.resume import write
from render.training.geometry import teeth

COUNT, PIXELS = 40, 600


class Studio:
    """Splats in two groups whose true colours are sharper than their textures."""

    blends = np.array([[0.0, 1.6, -0.4, -0.2], [0.7, 0.3, 0.1, -0.1]])

    def __init__(self) -> None:
        self.groups = np.arange(COUNT) % 2
        self.widths = self.opacities = np.ones(COUNT, np.float32)
        self.gloss = self.roughness = np.zeros(COUNT, np.float32)

    def views(self, seed: int, rng: np.random.Generator) -> list[fit.ReferenceView]:
        levels = rng.uniform(0.4, 0.5, (COUNT, textures.LEVELS, 3)).astype(np.float32)
        shares = rng.random((PIXELS, COUNT)).astype(np.float32)
        shares /= shares.sum(1, keepdims=True)
        light = rng.uniform(0.3, 0.9, (COUNT, 3)).astype(np.float32)
        mirrored = rng.uniform(0, 0.05, (COUNT, 3)).astype(np.float32)
        albedo = np.einsum("nl,nlc->nc", self.blends[self.groups], levels)
        picture = shares @ developed(albedo**2 * light + mirrored)
        return [fit.ReferenceView(levels, csr_array(shares), light, mirrored, picture)]


def test_the_fit_finds_how_sharp_gaussians_read():
    studio = Studio()
    found = fit.run(studio, [1, 2, 3], 0)  # pyright: ignore[reportArgumentType] (stand-in)
    further = fit.PLAIN + fit.SHARPER * (studio.blends - fit.PLAIN)
    np.testing.assert_allclose(found.mixing, further[studio.groups], atol=0.05)
    np.testing.assert_allclose(found.mixing.sum(1), 1, atol=1e-5)


def test_a_fit_is_made_once(tmp_path: Path):
    studio, path = Studio(), tmp_path / "fitted.npz"
    first = fit.load(studio, [1], 0, path)  # pyright: ignore[reportArgumentType] (stand-in)
    again = fit.load(studio, [2], 1, path)  # pyright: ignore[reportArgumentType] (stand-in)
    np.testing.assert_array_equal(first.mixing, again.mixing)


def examples(num: int = 6) -> learn.Examples:
    rng = np.random.default_rng(0)

    def maps(*shape: int) -> torch.Tensor:
        return torch.from_numpy(rng.standard_normal(shape).astype(np.float32) * 0.1)

    return learn.Examples(
        identity=maps(2, networks.IDENTITY_INPUTS, atlas.HEIGHT, atlas.WIDTH),
        person=torch.arange(num) % 2,
        change=maps(num, networks.EXPRESSION_INPUTS, atlas.HEIGHT, atlas.WIDTH),
        code=maps(num, networks.CODE_DIM) * 10,
        light=maps(num, 30, 2),
        neutral_code=torch.zeros(networks.CODE_DIM),
    )


def test_the_networks_go_on_where_they_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Saved after the second step, stopped in the fourth: the same weights to the bit."""
    data, weights = examples(), np.ones(30, np.float32)
    places = np.random.default_rng(1).uniform(2, 60, (30, 2)).astype(np.float32)
    to_vertices = atlas.build(places).to_vertices
    monkeypatch.setattr(learn, "BATCH", 1)
    monkeypatch.setattr(learn, "SAVED_EVERY", 2)
    whole, _ = learn.run(data, data, to_vertices, weights, tmp_path / "whole.state", 4, 0)

    seen, step = [], learn.step

    def stops(*args: Any) -> Any:
        seen.append(args)
        if len(seen) == 4:
            raise KeyboardInterrupt
        return step(*args)

    state = tmp_path / "state"
    monkeypatch.setattr(learn, "step", stops)
    with pytest.raises(KeyboardInterrupt):
        learn.run(data, data, to_vertices, weights, state, 4, 0)
    monkeypatch.setattr(learn, "step", step)
    resumed, left = learn.run(data, data, to_vertices, weights, state, 4, 0)
    for a, b in zip(whole.light.parameters(), resumed.light.parameters(), strict=True):
        torch.testing.assert_close(a, b, rtol=0, atol=0)
    assert np.isfinite(left)
    assert learn.changes(resumed, data).shape == (6, atlas.HEIGHT * atlas.WIDTH, 2)


@pytest.mark.slow
def test_the_debug_preset_has_steps_enough(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(learn, "BATCH", 1)
    data, steps = examples(4), prior.PRESETS["debug"].steps
    to_vertices = atlas.build(
        np.random.default_rng(1).uniform(2, 60, (30, 2)).astype(np.float32)
    ).to_vertices
    left = learn.run(data, data, to_vertices, np.ones(30, np.float32), tmp_path / "s", steps, 0)[1]
    assert np.isfinite(left)


def test_teeth_read_their_light_from_the_texels_that_tell_it():
    rng = np.random.default_rng(2)
    maps = rng.standard_normal((80, 400, 2)).astype(np.float32)
    mixing = rng.standard_normal((3, 25)).astype(np.float32)
    truth = np.einsum("ntk,tm->nmk", maps[:, [7, 90, 300]], mixing)
    found = teeth.light(maps, truth, np.arange(25))
    texels, weights = found["teeth_texels"], found["teeth_light"].astype(np.float32)
    assert {7, 90, 300} <= set(texels.tolist()) and weights.shape == (25, teeth.TEXELS)
    predicted = np.einsum("ntk,mt->nmk", maps[:, texels], weights)
    assert ((predicted - truth) ** 2).sum() < 0.01 * (truth**2).sum()


def test_a_draft_never_takes_the_place_of_a_whole_file(tmp_path: Path):
    path = tmp_path / "deep" / "kept.bin"
    write(path, lambda draft: draft.write_bytes(b"whole"))

    def fails(draft: Path) -> None:
        draft.write_bytes(b"ha")
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write(path, fails)
    assert path.read_bytes() == b"whole"
