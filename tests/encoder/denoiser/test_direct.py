"""The direct path by itself; how it is trained: training/test_listen.py."""

import torch

from encoder.denoiser.direct import Direct


def test_a_path_that_hears_a_voice_and_learned_nothing_changes_nothing() -> None:
    torch.manual_seed(0)
    direct, x0 = Direct(7, 256, 5), torch.randn(2, 9, 256)
    torch.nn.init.normal_(direct.read)
    torch.nn.init.constant_(direct.voice.bias, 50)
    torch.testing.assert_close(direct(x0, torch.randn(2, 9, 7))[0], x0)
