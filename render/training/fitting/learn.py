"""Trains the prior's networks: a VAE over expressions, conditioned on who makes them.

Input is the change of geometry and of light from that person's neutral face. The mean of the code
is the fixed linear map of the rig plus what the encoder finds; the decoder must say how the light
on the face changes, also without the latter, as from who sends the rig alone. Held-out people and
expressions judge it. Minutes on one core.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from scipy.sparse import csr_array
from torch import Tensor
from tqdm import tqdm

from render.avatars.maker import GEOMETRY_UNIT_MM, identity_maps
from render.avatars.textures import at_vertices
from render.decoder.coding import Coding
from render.decoder.learned import networks
from render.decoder.learned.atlas import Atlas, picture
from render.decoder.mesh_parts import SKIN_VERTICES
from render.training.data import people
from render.training.fitting.resume import write
from render.training.fitting.truth import Truth
from render.training.fitting.wardrobe import Wardrobe
from render.training.geometry.assembly import Assembly
from render.types import Floats

NUM_RIG = 55  # shapes of the rig and of the tongue
KL_WEIGHT = 2e-5
RATE = 2e-3
BATCH, JUDGED = 48, 60
RIG_ALONE = 0.5  # share of examples without what the encoder finds
SAVED_EVERY = 100  # steps
MAPPED = 720  # expressions that the teeth learn their light from


@dataclass(frozen=True)
class Examples:
    """Everything as maps; one row an expression, people apart."""

    identity: Tensor  # [P, 8, 64, 128]
    person: Tensor  # [N]
    change: Tensor  # [N, 5, 64, 128]
    code: Tensor  # [N, 256] normalised; its rig part is the truth, its free part zero
    light: Tensor  # [N, U, 2] change of the light seen, per vertex
    neutral_code: Tensor  # [256] normalised code of the neutral face

    def to(self, device: str) -> "Examples":
        return Examples(*(part.to(device) for part in vars(self).values()))


def examples(  # type: ignore[no-untyped-def]
    assembly: Assembly, truth: Truth, coding: Coding, atlas: Atlas, used, wardrobe: Wardrobe
) -> Examples:
    """Pose every sample of the truth; the first of each person is the neutral face."""
    identities, persons, changes, codes, lights = [], [], [], [], []
    template = assembly.posing.rest(assembly.face.neutral).geometry[used]
    still = np.zeros(len(assembly.names), np.float32)
    plain = np.rint(assembly.colors[used] * 255).astype(np.uint8)
    for row, seed in enumerate(np.unique(truth.seeds)):
        rows = np.flatnonzero(truth.seeds == seed)
        person = people.draw(assembly.face, int(seed))
        rest = assembly.posing.rest(people.neutral(assembly.face, person))
        assert (truth.rig[rows[0]] == still).all()
        base = truth.seen[rows[0]][used].astype(np.float32) / np.float32(255)
        skin = wardrobe.texture(person)
        albedo = at_vertices(skin, plain, assembly.vertex_uv[used], used < SKIN_VERTICES)
        identities.append(identity_maps(atlas, albedo, rest.geometry[used] - template, base))
        for index in rows[1:]:
            posed = assembly.posing.pose(truth.rig[index], truth.gaze[index], rest)
            light = truth.seen[index][used].astype(np.float32) / 255 - base
            moved = (posed - rest.geometry)[used] / GEOMETRY_UNIT_MM
            changes.append(picture(atlas, np.concatenate([moved, light], 1)))
            codes.append(coding.normalised(truth.rig[index] @ coding.to_code))
            lights.append(light)
            persons.append(row)
    neutral = coding.normalised(np.zeros(networks.CODE_DIM, np.float32))
    arrays = (identities, persons, changes, codes, lights, neutral)
    return Examples(*(torch.from_numpy(np.array(a)) for a in arrays))


@dataclass(frozen=True)
class DecoderNetworks:
    identity: networks.IdentityEncoder
    expression: networks.ExpressionEncoder
    light: networks.LightDecoder


def run(
    data: Examples,
    held_out: Examples,
    read_map: csr_array,  # [U, T]
    weights: Floats,  # [U] how much a vertex matters
    state: Path,
    steps: int,
    seed: int,
    device: str = "cpu",
) -> tuple[DecoderNetworks, float]:
    """Train; also the share of the held-out light's change that stays unexplained.

    `state` is written every SAVED_EVERY steps and continued from.
    """
    coo = read_map.tocoo()
    read = torch.sparse_coo_tensor(
        torch.from_numpy(np.stack(coo.coords)),
        torch.from_numpy(coo.data),
        coo.shape,
        check_invariants=False,
    ).coalesce()
    read, weight = read.to(device), torch.from_numpy(weights).to(device)
    data, held_out = data.to(device), held_out.to(device)
    torch.manual_seed(seed)
    free_dim = networks.CODE_DIM - NUM_RIG
    made = DecoderNetworks(
        networks.IdentityEncoder(), networks.ExpressionEncoder(free_dim), networks.LightDecoder()
    )
    modules = torch.nn.ModuleList([made.identity, made.expression, made.light]).to(device)
    optimizer = torch.optim.AdamW(modules.parameters(), RATE, weight_decay=1e-4)
    rises = max(0.1, 2 / steps)  # of the steps: at least two, the scheduler divides by one less
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, RATE, steps, pct_start=rises)
    draw = torch.Generator().manual_seed(seed)
    parts, done = {"modules": modules, "optimizer": optimizer, "schedule": schedule}, 0
    if state.exists():
        kept = torch.load(state, weights_only=True, map_location="cpu")
        done = kept["done"]
        draw.set_state(kept["draw"])
        for name, part in parts.items():
            part.load_state_dict(kept[name])
    bar, recent = tqdm(range(done, steps), "networks", steps, unit="step", initial=done), []
    for index in bar:
        rows = torch.randint(len(data.person), (BATCH,), generator=draw)
        loss, explained = step(made, data, rows, read, weight, draw)
        optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(modules.parameters(), 1.0)
        optimizer.step()
        schedule.step()
        recent.append(explained)
        bar.set_postfix(left=f"{np.mean(recent[-100:]):.3f}")
        if (index + 1) % SAVED_EVERY == 0 or index == steps - 1:
            kept = {name: part.state_dict() for name, part in parts.items()}
            kept |= {"done": index + 1, "draw": draw.get_state()}
            write(state, lambda draft, kept=kept: torch.save(kept, draft))
    with torch.no_grad():
        rows = torch.arange(len(held_out.person))[:JUDGED]
        left = step(made, held_out, rows, read, weight, None)[1]
    modules.cpu()
    return made, left


@torch.no_grad()
def changes(made: DecoderNetworks, data: Examples) -> Floats:  # [N, T, 2]
    """The change of light on every texel, for the first expressions."""
    still, out = data.neutral_code[None], []
    for person, code in zip(data.person[:MAPPED], data.code[:MAPPED], strict=True):
        biases = made.identity(data.identity[person][None])
        change = made.light(code[None], biases) - made.light(still, biases)
        out.append(change[0].flatten(1).T.numpy())
    return np.array(out, np.float32)


def step(
    made: DecoderNetworks,
    data: Examples,
    rows: Tensor,
    read: Tensor,
    weight: Tensor,
    draw: torch.Generator | None,
) -> tuple[Tensor, float]:
    """Loss of a batch, and the share of the light's change that stays unexplained."""
    biases = made.identity(data.identity[data.person[rows]])
    free, log_variance = made.expression(data.change[rows])
    code = torch.cat([data.code[rows][:, :NUM_RIG], free], 1)
    if draw is not None:
        kept = (torch.rand(len(rows), 1, generator=draw) >= RIG_ALONE).to(free)
        noise = torch.randn(code.shape, generator=draw).to(free)
        code = torch.cat([code[:, :NUM_RIG], kept * free], 1)
        code = code + kept * noise * torch.exp(0.5 * log_variance)
    still = data.neutral_code.expand_as(code)
    change = made.light(code, biases) - made.light(still, biases)
    flat = change.flatten(2).permute(2, 0, 1).flatten(1)  # [T, B * 2]
    light = (read @ flat).reshape(len(weight), len(rows), 2).permute(1, 0, 2)
    target = data.light[rows]
    error = (weight[:, None] * (light - target) ** 2).sum() / weight.sum()
    scale = (weight[:, None] * target**2).sum() / weight.sum()
    kl = networks.divergence(free, log_variance[:, NUM_RIG:])
    loss = error / len(rows) * 100 + KL_WEIGHT * kl
    return loss, float(error.detach() / scale)
