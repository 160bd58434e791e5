"""Losses with known answers: ratio jitter, velocity, spread, contact, teacher and truth."""

import pytest
import torch
from training_material import FACE

from encoder.audio.config import PRESETS
from encoder.denoiser.config import MOUTH
from encoder.denoiser.config import PRESETS as DENOISERS
from encoder.denoiser.diffusion import Schedule
from encoder.denoiser.model import Denoiser
from encoder.training.centred import HISTORY_FRAMES, CentredEncoder, fed_causally
from encoder.training.distribution import dmd_loss, mouth_error
from encoder.training.geometry import (
    JITTER_FLOOR_MM,
    contact_loss,
    jitter,
    jitter_loss,
    spread_loss,
    velocity_loss,
)

ONE = torch.ones(1)


def curve(third: float) -> torch.Tensor:
    """[1, 4, 1, 3]: x whose only third difference is `third`; y and z rest."""
    x = torch.zeros(1, 4, 1, 3, dtype=torch.float64)
    x[0, 3, 0, 0] = third
    return x


def test_jitter_is_the_third_difference():
    v = torch.randn(1, 5, 2, 3)
    expected = v[:, 3] - 3 * v[:, 2] + 3 * v[:, 1] - v[:, 0]
    torch.testing.assert_close(jitter(v)[:, 0], expected)


@pytest.mark.parametrize("truth", [2.0, -2.0])
def test_above_the_floor_jitter_is_the_ratio_of_the_paper(truth):
    loss = jitter_loss(curve(3.0), curve(truth), ONE)
    assert float(loss) == pytest.approx((3 / truth - 1) ** 2 / 3)


@pytest.mark.parametrize("truth", [0.0, 0.1, -0.1])
def test_below_the_floor_the_minimum_stays_at_the_truth(truth):
    at_truth = curve(truth).requires_grad_()
    loss = jitter_loss(at_truth, curve(truth), ONE)
    loss.backward()
    assert float(loss) == 0 and float(at_truth.grad.abs().max()) == 0
    off = curve(truth + 0.2).requires_grad_()
    jitter_loss(off, curve(truth), ONE).backward()
    expected = 2 * 0.2 / JITTER_FLOOR_MM**2 / 3  # the documented gradient, mean over three axes
    assert float(off.grad[0, 3, 0, 0]) == pytest.approx(expected)


def test_a_larger_face_counts_the_same_only_when_normalised():
    small, large = (jitter_loss(s * curve(6.0), s * curve(3.0), ONE) for s in (1, 2))
    assert float(small) == pytest.approx(float(large))
    plain = [jitter_loss(s * curve(6.0), s * curve(3.0), ONE, normalised=False) for s in (1, 2)]
    assert float(plain[1]) == pytest.approx(4 * float(plain[0]))


def test_velocity_weighs_vertices():
    a, b = torch.zeros(1, 2, 2, 3), torch.zeros(1, 2, 2, 3)
    a[0, 1, 0, 0] = 2.0
    assert float(velocity_loss(a, b, torch.tensor([1.5, 0.5]))) == pytest.approx(4 * 1.5 / 2)


def test_spread_asks_a_timid_mouth_to_move_and_a_resting_one_to_rest():
    truth = torch.zeros(1, 40, 1, 3)
    truth[0, :, 0, 1] = torch.sin(torch.arange(40.0)) * 4
    timid = (0.5 * truth).requires_grad_()
    loss = spread_loss(timid, truth, ONE)
    assert float(loss.detach()) == pytest.approx(float(0.25 * truth.var(1).sum()), rel=0.05)
    loss.backward()
    assert (timid.grad * truth).sum() < 0  # a step down the gradient moves more
    restless = (0.1 * truth).requires_grad_()
    spread_loss(restless, torch.zeros_like(truth), ONE).backward()
    assert (restless.grad * truth).sum() > 0
    still = torch.zeros_like(truth).requires_grad_()
    spread_loss(still, torch.zeros_like(truth), ONE).backward()
    assert still.grad.isfinite().all()


def speaking(*closures: int) -> torch.Tensor:
    """Gaps of lips 6 mm apart but for closures of two frames."""
    gaps = torch.zeros(1, 60, 1, 3)
    gaps[..., 1] = 6.0
    for start in closures:
        gaps[0, start : start + 2] = 0
    return gaps


def test_contact_asks_for_closures_within_two_frames_and_for_no_others():
    truth = speaking(30)
    exact, late, missed = (float(contact_loss(speaking(*at), truth)) for at in ((30,), (32,), ()))
    too_late, false = (float(contact_loss(speaking(*at), truth)) for at in ((36,), (10, 30)))
    assert exact < 1e-3 and late < 0.6 * missed
    assert too_late > missed > 1.9 * false > 0.05


def test_contact_leaves_open_lips_alone_and_holds_lips_at_rest():
    truth = speaking()
    wide = (truth * 1.5).requires_grad_()
    loss = contact_loss(wide, truth)
    loss.backward()
    assert float(loss.detach()) < 1e-3 and wide.grad.abs().max() < 1e-3
    rest = torch.zeros(1, 60, 1, 3)
    restless = torch.zeros_like(rest)
    restless[..., 2] = 0.1  # sideways: closeness does not see it
    near, far = ((rest + size * restless).requires_grad_() for size in (1, 10))
    for gaps in (near, far):
        contact_loss(gaps, rest).backward()
    torch.testing.assert_close(near.grad, far.grad, rtol=0.02, atol=1e-6)
    assert (near.grad[..., 2] > 0).all()


def test_centred_encoder_hears_half_a_second_ahead():
    torch.manual_seed(0)
    config = PRESETS["phonetic"]
    encoder = CentredEncoder(config).eval()
    audio = torch.randn(1, 24_000 * 2, 1) * 0.1
    later = audio.clone()
    later[:, 24_000:] = 0
    changed = (encoder(audio) - encoder(later)).abs().amax((0, 2)) > 1e-6
    first = int(changed.nonzero()[0])
    ahead_s = 1 - first * config.stride / config.sample_rate
    assert 0.5 < ahead_s < 0.6


def test_fed_causally_hears_nothing_ahead():
    torch.manual_seed(0)
    encoder = CentredEncoder(PRESETS["phonetic-debug"]).eval()
    frames = HISTORY_FRAMES + 4
    audio = torch.randn(800 * frames) * 0.1
    later = audio.clone()
    later[800 * 5 :] = 0
    a, b = (fed_causally(encoder, x, 800) for x in (audio, later))
    assert a.shape == (frames, encoder.config.frame_width)
    assert torch.equal(a[:5], b[:5]) and not torch.allclose(a[5], b[5])


@pytest.mark.slow
def test_dmd_gradient_points_to_the_teacher():
    torch.manual_seed(0)
    near, far = torch.full((1, 4, 256), 1.0), torch.zeros(1, 4, 256)

    class Constant(torch.nn.Module):
        def __init__(self, value: torch.Tensor) -> None:
            super().__init__()
            self.value = value

        def forward(self, *_: object) -> torch.Tensor:
            return self.value

    z = torch.zeros(1, 4, 256, requires_grad=True)
    none = torch.zeros(1, 4, 1)
    dmd_loss(Constant(far), Constant(near), z, none, none, Schedule()).backward()
    assert z.grad is not None and (z.grad < 0).all()  # a step down the gradient rises to 1


@pytest.mark.slow
def test_the_truth_holds_the_mouth_and_leaves_the_eyes_to_the_teacher():
    student, codes, weight = Denoiser(DENOISERS["debug"]), torch.zeros(1, 4, 256), torch.ones(1, 4)
    student.expression_std.fill_(3.0)
    z = torch.zeros(1, 4, 256)
    z[..., MOUTH:] = 1.0
    assert mouth_error(student, z, codes, weight, FACE) == 0
    z[..., :MOUTH] = 1.0
    assert mouth_error(student, z, codes, weight, FACE) == pytest.approx(MOUTH / 256)
