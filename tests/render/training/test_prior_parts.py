"""Parts of the prior: code, ARKit map, light decoder in numpy and torch, figures, splatter."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from scenes import facing

from render import arkit
from render.cameras import portrait
from render.decoder.coding import EXPRESSION_DIM, Coding, extend
from render.decoder.learned import networks
from render.decoder.learned.light import PARTS, LightNet, tensors_of
from render.evaluation import metrics as prior_metrics
from render.splats.reference import ReferenceRenderer
from render.types import Gaussians
from sensors.types import InputError


def test_arkit_goes_through_the_code_and_back(decoder):
    weights = np.random.default_rng(0).uniform(0, 1, (20, 52)).astype(np.float32)
    weights[:, arkit.NAMES.index("tongueOut")] = 0
    code = decoder.encode(arkit.to_rig(weights, decoder.rig_names))
    back = arkit.from_rig(decoder.rig(code), decoder.rig_names)
    np.testing.assert_allclose(back, weights, atol=2e-4)


def test_the_arkit_map_knows_left_and_right(decoder):
    matrix = arkit.matrix(decoder.rig_names)
    assert matrix.shape == (52, 53)
    row = matrix[arkit.NAMES.index("mouthSmileLeft")]
    assert [decoder.rig_names[i] for i in np.flatnonzero(row)] == ["mouthSmile_L"]
    both = matrix[arkit.NAMES.index("browInnerUp")]
    assert [decoder.rig_names[i] for i in np.flatnonzero(both)] == [
        "browInnerUp_L",
        "browInnerUp_R",
    ]
    assert not matrix[arkit.NAMES.index("tongueOut")].any()
    assert matrix[arkit.NAMES.index("mouthLeft")].sum() == 1


def test_a_live_link_table_is_read_and_a_wrong_one_refused(tmp_path: Path):
    path = tmp_path / "take.csv"
    head = ["Timecode", "BlendShapeCount", *(n[0].upper() + n[1:] for n in arkit.NAMES)]
    row = ["00:00:00:00.0", "52", *("0.5" for _ in arkit.NAMES)]
    lost = ["00:00:01:00.0", "0"]
    path.write_text("\n".join(",".join(r) for r in (head, row, lost)))
    np.testing.assert_array_equal(arkit.read_live_link(path), np.full((1, 52), 0.5, np.float32))
    words = [",".join(head).encode(), ",".join(row).encode()]
    for damaged, got in {
        b"": "no Timecode",
        words[0].replace(b"JawOpen", b"x"): "no JawOpen",
        words[0]: "none; record",  # red before, as the three below
        b"\n".join(words).replace(b"0.5", b"nan"): "'nan'",
        b"\n".join(words).replace(b"0.5", b"half"): "'half'",
        b"\x8a\xff" * 16: "can't decode",
    }.items():
        path.write_bytes(damaged)
        with pytest.raises(InputError, match=f"take.csv: .*got .*{got}"):
            arkit.read_live_link(path)


def test_the_tongue_and_the_free_part_leave_the_rig_alone(decoder):
    to_code, to_rig, free, frame = extend(decoder.to_code, decoder.to_rig, 3)
    np.testing.assert_array_equal(to_code[:53], decoder.to_code)
    np.testing.assert_allclose(free @ to_rig, 0, atol=1e-4)
    np.testing.assert_allclose(to_code @ to_rig, np.eye(55), atol=1e-3)
    np.testing.assert_allclose(frame @ frame.T, np.eye(EXPRESSION_DIM), atol=1e-4)
    zero, one = np.zeros(EXPRESSION_DIM, np.float32), np.ones(EXPRESSION_DIM, np.float32)
    coding = Coding(to_code, to_rig, free, frame, zero + 0.3, one * 2)
    code = np.random.default_rng(1).standard_normal(EXPRESSION_DIM).astype(np.float32)
    np.testing.assert_allclose(coding.code(coding.normalised(code)), code, atol=1e-4)


def test_the_light_decoder_is_the_same_in_numpy_and_torch():
    torch.manual_seed(4)
    network = networks.LightDecoder()
    with torch.no_grad():
        for value in network.parameters():
            value.copy_(value.half().float())  # what the file keeps
    code = torch.randn(1, 256)
    sizes = [(networks.BASE[0] << i, networks.BASE[1] << i) for i in range(4)]
    biases = [torch.randn(1, c, *size) for c, size in zip(networks.CHANNELS, sizes, strict=True)]
    with torch.no_grad():
        expected = network(code, biases)[0].flatten(1).T.numpy()
    flat = tuple(b[0].flatten(1).T.contiguous().numpy() for b in biases)
    light = LightNet.of(tensors_of(network))
    found = light(code[0].numpy(), light.nested(flat))
    np.testing.assert_allclose(found, expected[light.order(len(flat))], atol=1e-4)
    texels = networks.BASE[0] * networks.BASE[1] << 2 * np.arange(len(light.ups))
    sizes = [light.first.size] + [n * up.size for n, up in zip(texels, light.ups, strict=True)]
    assert max(sizes) / PARTS < 400_000, (
        "BLAS would wake threads (measured: a tick takes twice as long)"
    )


def test_psnr_and_ssim_look_inside_the_mask_only():
    rng = np.random.default_rng(0)
    a = rng.integers(0, 255, (40, 40, 3)).astype(np.uint8)
    b, mask = a.copy(), np.zeros((40, 40), bool)
    mask[:15] = True
    b[25:] = 0
    assert prior_metrics.psnr_db(a, b, mask) == 99.0
    assert prior_metrics.ssim(a, b, mask) == pytest.approx(1.0)
    assert prior_metrics.psnr_db(a, b, ~mask) < 15
    assert prior_metrics.ssim(a, 255 - a, mask) < 0
    shifted = (a.astype(int) + 10).clip(0, 255).astype(np.uint8)
    inside = (a < 245).all(2)
    assert prior_metrics.psnr_db(a, shifted, inside) == pytest.approx(20 * np.log10(25.5), abs=1e-6)


def test_crossing_lips_are_found():
    rest = np.array([[0, 0.2, 0], [4, 0.2, 0], [0, 0, 0], [4, 0, 0]], np.float32)
    upper, lower = np.array([0, 1], np.int32), np.array([2, 3], np.int32)
    judge = prior_metrics.LipCrossing(rest, upper, lower)
    assert judge.depth_mm(rest) == 0
    crossed = rest.copy()
    crossed[1, 1] = -0.7
    assert judge.depth_mm(crossed) == pytest.approx(0.7)


@pytest.mark.slow
def test_fitting_splats_are_the_reference_splats():
    """The shares of Gaussians in pixels give what render/splats/reference.py draws."""
    from render.training.fitting import splatter

    rng = np.random.default_rng(2)
    count, flatness = 300, 0.2
    means = rng.normal((0, 15, 0), (50, 50, 20), (count, 3)).astype(np.float32)
    normals = rng.standard_normal((count, 3)).astype(np.float32)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    widths = rng.uniform(1, 9, count).astype(np.float32)
    opacities = rng.uniform(0.05, 0.99, count).astype(np.float32)
    colors = rng.random((count, 3)).astype(np.float32)
    camera = replace(portrait(72, 64, yaw_deg=15), near_mm=1.0)
    shares, left = splatter.shares(means, normals, widths, flatness, opacities, camera)
    found = shares @ colors + left[:, None] * np.array(camera.background)
    scales = np.repeat(widths[:, None], 3, 1)
    scales[:, 2] *= flatness
    reference = ReferenceRenderer()
    reference.draw(Gaussians(means, facing(normals), scales, opacities, colors), camera)
    expected = reference.read_float()[..., :3].reshape(-1, 3)
    assert np.abs(found - expected).mean() < 3e-3
    assert np.quantile(np.abs(found - expected), 0.99) < 0.03
