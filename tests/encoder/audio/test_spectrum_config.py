"""Powers by a Fourier transform are those of the kernels, as the torch twin has them."""

import numpy as np

from encoder.audio.config import PHONETIC


def test_powers_are_those_of_the_kernels() -> None:
    config, rng = PHONETIC.spectrum, np.random.default_rng(0)
    assert config is not None
    windows = rng.standard_normal((4, config.window)).astype(np.float32)
    windows[1] *= 1e-4
    windows[2] += 100 * np.sin(np.arange(config.window) * 0.3)  # one bin drowns the others
    found = config.powers(windows)
    waves = windows.astype(np.float64) @ config.kernels()
    expected = np.sqrt(waves[:, : config.bins] ** 2 + waves[:, config.bins :] ** 2)
    assert found.dtype == np.float32 and found.shape == (4, config.bins)
    assert np.all(np.abs(np.sqrt(found) - expected) < 1e-6 * expected.max(1)[:, None])
