"""The decoder for a GPU does what the numpy decoder does; on the CPU, where every test runs."""

import numpy as np
import pytest
import torch

from render import identity
from render.decoder import Decoder
from render.torch_decoder import TorchDecoder, on_device
from render.types import FIELDS

GPU = pytest.param("cuda", marks=pytest.mark.skipif(not torch.cuda.is_available(), reason="no GPU"))


def faces(decoder: Decoder, count: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Codes and gazes: plausible, exaggerated (lips cross, lids meet), asleep."""
    rng = np.random.default_rng(3)
    found = []
    for k in range(count):
        gaze = np.c_[0.4 * rng.standard_normal((2, 2)), np.ones(2)].astype(np.float32)
        found.append(
            (decoder.sample(rng) * (1, 2)[k % 2], gaze / np.linalg.norm(gaze, axis=1)[:, None])
        )
    asleep = np.zeros(53, np.float32)
    asleep[[decoder.rig_names.index(f"eyeBlink_{side}") for side in "LR"]] = 1
    return [*found, (decoder.encode(asleep), found[0][1])]


@pytest.mark.parametrize("device", ["cpu", GPU])
@pytest.mark.parametrize("name", ["hugo", "lena"])
def test_decodes_as_the_numpy_decoder(device: str, name: str) -> None:
    decoder, who = Decoder.load(gaussians="16k"), identity.load(name)
    ported = TorchDecoder(decoder, device)
    for code, gaze in faces(decoder, 6):
        mesh, cloud = decoder.decode(code, gaze, who)
        ours, splats = ported.decode(code, gaze, who)
        np.testing.assert_allclose(ours.vertices, mesh.vertices, atol=1e-3)
        for field in FIELDS:
            np.testing.assert_allclose(getattr(splats, field), getattr(cloud, field), atol=1e-3)


def test_results_are_the_callers_own() -> None:
    decoder, who = Decoder.load(gaussians="16k"), identity.load("ben")
    ported = TorchDecoder(decoder, "cpu")
    (first, gaze), (second, _) = faces(decoder, 2)[:2]
    mesh, cloud = ported.decode(first, gaze, who)
    kept = mesh.vertices.copy(), cloud.means.copy()
    ported.decode(second, gaze, who)
    np.testing.assert_array_equal(mesh.vertices, kept[0])
    np.testing.assert_array_equal(cloud.means, kept[1])


def test_the_same_input_gives_the_same_bits() -> None:
    decoder, who = Decoder.load(gaussians="16k"), identity.load("ben")
    ported = TorchDecoder(decoder, "cpu")
    (code, gaze), (other, _) = faces(decoder, 2)[:2]
    first = ported.decode(code, gaze, who)[1]
    ported.decode(other, gaze, who)
    for field in FIELDS:
        again = getattr(ported.decode(code, gaze, who)[1], field)
        np.testing.assert_array_equal(getattr(first, field), again)


def test_cpu_keeps_the_numpy_decoder() -> None:
    decoder = Decoder.load(gaussians="16k")
    assert on_device(decoder, "cpu") is on_device(decoder, "auto") is decoder
