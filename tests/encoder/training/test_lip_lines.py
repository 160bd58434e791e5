"""The straight lines of the lips: fair to talkers, taken into the direct path exactly."""

import numpy as np
import torch

from encoder.denoiser.config import MOUTH
from encoder.denoiser.direct import Direct
from encoder.training.streams.lip_lines import LipLines, fit_lines


def noise(seed: int, *shape: int) -> torch.Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed))


def test_lines_are_found_again() -> None:
    seen, lines = noise(0, 900, 12), noise(1, 12, 2)
    weight, offset = fit_lines(seen, seen @ lines + 3, np.repeat("anna", 900))
    torch.testing.assert_close(weight, lines, atol=0.03, rtol=0.03)
    torch.testing.assert_close(offset, torch.tensor([3.0, 3.0]), atol=0.05, rtol=0)


def test_each_talker_counts_alike() -> None:
    seen, talkers = noise(0, 1000, 5), np.repeat(["anna", "ben"], [900, 100])
    opening = seen[:, 0] * torch.from_numpy(np.where(talkers == "ben", 3.0, 1.0)).float()
    weight, _ = fit_lines(seen, torch.stack([opening, opening], 1), talkers)
    assert 1.7 < weight[0, 0] < 2.3  # by frames it would be 1.2


def test_a_direct_path_takes_the_lines_in() -> None:
    direct, seen, ways = Direct(7, 256, 5), noise(0, 2, 9, 14), 0.5 * noise(1, 2, MOUTH)
    for tensor in direct.parameters():
        torch.nn.init.normal_(tensor, std=0.3)
    kept = torch.eye(MOUTH) - noise(2, MOUTH, 2) @ ways
    lines = LipLines(noise(3, 14, 2), torch.tensor([0.7, -0.4]), ways, kept)
    wanted = lines.beside(direct.said(seen), seen)
    lines.fold(direct)
    torch.testing.assert_close(direct.said(seen), wanted, atol=1e-4, rtol=1e-4)
