"""Stages of `livedrive train prior` that need no face data: stopped, they go on where they were."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from scenes import facing

from render import atlas, networks, textures
from render.cameras import portrait
from render.surface import Placed
from render.training import fit, learn, prior, teeth
from render.training.resume import write

COUNT = 40


class Studio:
    """A wall of splats in two colours, as a studio that never runs out of pictures."""

    num_people = 2

    def __init__(self, stop_at: int | None = None) -> None:
        self.faint = torch.zeros(COUNT, dtype=torch.bool)
        self.surface = SimpleNamespace(scales=np.full(COUNT, 6, np.float32))
        self.views, self._stop_at = 0, stop_at

    def seed(self, index: int) -> int:
        return index // 2

    def levels(self, seed: int) -> np.ndarray:
        return np.full((COUNT, textures.LEVELS, 3), 0.3 + 0.4 * seed, np.float32)

    def view(self, index: int, rng: np.random.Generator) -> fit.View:
        self.views += 1
        if self.views == self._stop_at:
            raise KeyboardInterrupt
        ones = np.ones(COUNT, np.float32)
        means = np.zeros((COUNT, 3), np.float32)
        means[:, :2] = np.random.default_rng(0).uniform(-40, 40, (COUNT, 2))
        light = np.tile(np.array([1, 1, 1, 0], np.float32), (COUNT, 1))
        ahead = facing(np.tile(np.array([[0, 0, 1]], np.float32), (COUNT, 1)))
        picture = np.full((48, 48, 3), 0.3 + 0.4 * (index // 2), np.float32)
        return fit.View(portrait(48, 48), Placed(means, ahead, means, means), light, ones, picture)


def test_the_fit_goes_on_where_it_stopped(tmp_path: Path):
    state = tmp_path / "fit.state"
    stopped = Studio(stop_at=25 // fit.REUSE + fit.SAME_PERSON)
    with pytest.raises(KeyboardInterrupt):
        fit.run(stopped, 4, state, 40, 0)  # pyright: ignore[reportArgumentType] (stand-in)
    assert int(torch.load(state, weights_only=True)["done"]) == 20
    assert [path.name for path in tmp_path.iterdir()] == ["fit.state"]
    rest = Studio()
    fitted = fit.run(rest, 4, state, 40, 0)  # pyright: ignore[reportArgumentType] (stand-in)
    assert int(torch.load(state, weights_only=True)["done"]) == 40
    assert rest.views < 20 and np.abs(fitted.widths - 6).max() > 0.05
    again = Studio()
    fit.run(again, 4, state, 40, 0)  # pyright: ignore[reportArgumentType] (stand-in)
    assert again.views == 0


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
    read = atlas.build(places).read
    monkeypatch.setattr(learn, "BATCH", 1)
    monkeypatch.setattr(learn, "SAVED_EVERY", 2)
    whole, _ = learn.run(data, data, read, weights, tmp_path / "whole.state", 4, 0)

    seen, step = [], learn.step

    def stops(*args: Any) -> Any:
        seen.append(args)
        if len(seen) == 4:
            raise KeyboardInterrupt
        return step(*args)

    state = tmp_path / "state"
    monkeypatch.setattr(learn, "step", stops)
    with pytest.raises(KeyboardInterrupt):
        learn.run(data, data, read, weights, state, 4, 0)
    monkeypatch.setattr(learn, "step", step)
    resumed, left = learn.run(data, data, read, weights, state, 4, 0)
    for a, b in zip(whole.light.parameters(), resumed.light.parameters(), strict=True):
        torch.testing.assert_close(a, b, rtol=0, atol=0)
    assert np.isfinite(left)
    assert learn.changes(resumed, data).shape == (6, atlas.HEIGHT * atlas.WIDTH, 2)


def test_the_debug_preset_has_steps_enough(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(learn, "BATCH", 1)
    data, steps = examples(4), prior.PRESETS["debug"].steps
    read = atlas.build(np.random.default_rng(1).uniform(2, 60, (30, 2)).astype(np.float32)).read
    left = learn.run(data, data, read, np.ones(30, np.float32), tmp_path / "s", steps, 0)[1]
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
