"""The race of the peers: what it calls causal is causal, and it counts what a peer must run."""

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from torch import Tensor, nn  # noqa: E402

from app.bench.peers import race  # noqa: E402
from app.bench.peers.parts import Convolutions, SequenceDecoder, VectorQuantised, encoder  # noqa: E402
from app.bench.peers.table import PEERS, QUOTED, Peer, Stage  # noqa: E402
from encoder.audio import config as audio  # noqa: E402
from encoder.backends import Networks  # noqa: E402
from encoder.denoiser import config as denoiser  # noqa: E402

pytestmark = pytest.mark.slow


class Causal(nn.Module):
    def forward(self, x: Tensor) -> Tensor:
        return torch.cumsum(x, 1)


@pytest.mark.parametrize(
    ("build", "causal"),
    [
        (Causal, True),
        (lambda: Convolutions(2, 4, 8, 3), False),  # a frame or two ahead are seen
        (lambda: encoder(1, 4, 8, 2), False),
    ],
)
def test_nan_in_the_future_shows_who_looks_ahead(build: type[nn.Module], causal: bool) -> None:
    run, inputs = race._exported(Stage(build, ((1, 64, 4),)), 0)
    assert race._sees_no_future(run, inputs) is causal


def test_ours_is_causal_tick_by_tick() -> None:
    ears, thinker = audio.PRESETS["debug"], denoiser.PRESETS["debug"]
    rng = np.random.default_rng(0)
    tick = 4 * ears.feature_dim
    thinker = denoiser.DenoiserConfig(layers=2, dim=64, ff_dim=128, audio_dim=tick)
    networks = Networks(
        ears,
        race._random(audio.weight_shapes(ears), rng),
        thinker,
        race._random(denoiser.weight_shapes(thinker), rng),
    )
    row = race._streamed(networks, 0, int8=False)
    assert row["causal"] and row["waits_ms"] == 0 < row["computes_ms"]


def test_a_peer_waits_then_computes_every_stage_as_often_as_it_says(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """How a stage is exported is tested above."""
    inputs = [np.zeros((1, 8, 4), np.float32)]
    monkeypatch.setattr(race, "_exported", lambda *_: (lambda values: values[0], inputs))
    monkeypatch.setattr(race, "_timed", lambda run, inputs: 0.002)
    stage = Stage(lambda: encoder(1, 4, 8, 2), ((1, 8, 4),), 100)
    once = Stage(stage.build, stage.inputs)
    row = race._raced(Peer("peer", (stage, once), 0.5, "", ""), 0)
    assert row["waits_ms"] == 500
    assert row["computes_ms"] == pytest.approx(202)
    assert row["live_ms"] == pytest.approx(702)


def test_codes_and_decoders_keep_the_frames() -> None:
    assert VectorQuantised(8, 2, 8, 5)(torch.randn(1, 7, 16)).shape == (1, 7, 5)
    decoder = SequenceDecoder(1, 8, 16, 2, 3, 4, 6)
    assert decoder(torch.randn(2, 7, 4), torch.randn(2, 9, 3)).shape == (2, 7, 6)


def test_every_peer_says_where_it_is_from() -> None:
    names = [peer.name for peer in PEERS]
    assert len(set(names)) == len(names)
    assert all(peer.source and peer.schedule and peer.stages for peer in PEERS)


def test_what_is_quoted_is_not_run_but_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(race, "_ours", lambda seed: [("ours, 32 bits", None, False)])
    monkeypatch.setattr(race, "_streamed", lambda *a, **k: race._row(0.0, 0.003, causal=True))
    monkeypatch.setattr(race, "_raced", lambda *a: race._row(0.0, 9.0, causal=False))
    report = race.measure_peers(0)
    name = QUOTED[0].name
    assert report["metrics"][f"{name}/waits_ms"] == report["metrics"][f"{name}/live_ms"] == 260
    assert f"{name}/computes_ms" not in report["metrics"]
    assert report["quoted"][0]["source"]
    assert report["bars"][0]["value"] == pytest.approx(3 / 260, abs=1e-3)  # rounded
