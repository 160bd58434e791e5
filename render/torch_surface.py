"""Light on a posed mesh and the Gaussians that ride on it, in torch: `render/surface.py` for a GPU.

Every loop is a gather from lists of equal length: no atomic adds, so the same input gives the same
bits.
"""

from typing import NamedTuple

import numpy as np
import torch
from scipy.sparse import csr_array
from torch import Tensor

from render import surface
from render.beard import Beard
from render.decoder import Decoder, Known
from render.identity import Identity
from render.light_decoder import SLOPE
from render.lighting import BOUNCE, STUDIO, TOWARDS


class Sums(NamedTuple):
    """A sparse matrix [n, m] as lists of equal length."""

    places: Tensor  # [n, K]
    weights: Tensor  # [n, K], 0 where a row has fewer

    @classmethod
    def of(cls, matrix: csr_array, device: torch.device) -> "Sums":
        counts, starts = np.diff(matrix.indptr), matrix.indptr[:-1, None]
        slot = np.arange(max(int(counts.max(initial=0)), 1))
        real = slot < counts[:, None]
        entry = np.where(real, starts + slot, 0)
        weights = np.where(real, matrix.data[entry], 0).astype(np.float32)
        places = torch.tensor(matrix.indices[entry], dtype=torch.long, device=device)
        return cls(places, torch.tensor(weights, device=device))

    def __call__(self, x: Tensor) -> Tensor:  # [m, C] -> [n, C]
        return (self.weights[..., None] * x[self.places]).sum(1)


class TorchSurface:
    """The head's surface with one person's light and colours."""

    def __init__(self, decoder: Decoder, who: Identity, known: Known, device: torch.device) -> None:
        def put(x: object, dtype: torch.dtype = torch.float32) -> Tensor:
            return torch.tensor(np.asarray(x), dtype=dtype, device=device)

        head, coding, still = decoder.surface, decoder.coding, known.still
        to_normal = coding.frame.T / coding.deviation
        # normalisation of the code and the first layer are one product
        self._first = put(to_normal @ decoder.light.first)
        self._first_bias = put(
            decoder.light.first_bias - coding.mean / coding.deviation @ decoder.light.first
        )
        self._ups = [put(up) for up in decoder.light.ups]
        self._up_biases = [put(bias) for bias in decoder.light.up_biases]
        self._biases = [put(bias) for bias in known.biases]
        self._light_at_rest, self._seen_at_rest = put(known.light), put(who.seen.T)
        starts, texels, weights = decoder.texels
        read = csr_array((weights, texels, starts), (len(head.used), len(known.light)))
        self._read = Sums.of(read, device)

        rows, count = head.face.rows.ravel(), head.face.count
        triangles = np.repeat(np.arange(len(head.face.rows)), 3)
        there = rows < count
        ones = np.ones(int(there.sum()), np.float32)
        around = csr_array((ones, (rows[there], triangles[there])), (count, len(head.face.rows)))
        self._around = Sums.of(around, device)
        self._corners = put(head.face.corners.astype(np.int64), torch.long)
        self._live, self._used = put(head.live, torch.long), put(head.used, torch.long)
        self._flush = put(head.blood[:, None] * surface.FLUSH)
        self._rest_sums = put(still.sums)
        self._towards = put(TOWARDS.T)
        lamps, sky = STUDIO.terms
        self._lamps, self._sky = put(lamps), put(sky)
        self._shine = put(head.shine.T)
        normals = np.zeros((len(head.used), 3), np.float32)
        parts = np.zeros((len(head.used), 8), np.float32)
        normals[head.quiet], parts[head.quiet] = still.normals, still.parts
        self._normals, self._parts = put(normals), put(parts)

        anchors, shares, follows, rest_areas = head.anchors
        self._anchors, self._shares = put(anchors.astype(np.int64), torch.long), put(shares)
        self._follows, self._rest_areas = put(follows.astype(np.int64), torch.long), put(rest_areas)
        flat = np.array([1, 1, surface.FLATNESS], np.float32)
        self._widths, self._reflected = put(still.widths[:, None] * flat), put(known.reflected)

    def seen(self, code: Tensor) -> Tensor:  # [256] -> [U, 2]
        """Shares of the sky and of the key light that reach each used vertex."""
        x = code @ self._first + self._first_bias
        for up, up_bias, bias in zip(self._ups, self._up_biases, self._biases, strict=True):
            x = torch.nn.functional.leaky_relu(x.view_as(bias) + bias, float(SLOPE))
            x = torch.addmm(up_bias, x, up)
        return (self._seen_at_rest + self._read(x.view(-1, 2) - self._light_at_rest)).clamp(0, 1)

    def place(self, vertices: Tensor, seen: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """[V, 3] mm, [U, 2] -> means, quats, scales and colors of the anchored Gaussians."""
        a, b, c = vertices[self._corners].unbind(1)
        across = torch.linalg.cross(b - a, c - a)
        area = across.norm(dim=1)
        around = self._around(torch.cat([across, area[:, None]], 1))
        live = torch.nn.functional.normalize(around[:, :3], dim=1)
        stretch = (around[:, 3] / self._rest_sums).clamp(*map(float, surface.FLUSHES))
        gains = 1 + (stretch - 1)[:, None] * self._flush
        normals = self._normals.index_copy(0, self._live, live)
        parts = self._parts.index_copy(0, self._live, self._received(live, gains))
        sky, lit = seen[:, :1], seen[:, 1:]
        light = parts[:, :3] * (float(BOUNCE) + (1 - float(BOUNCE)) * sky) + parts[:, 3:6] * lit
        gloss = (self._shine * parts[:, 6:]).sum(1, keepdim=True) * lit
        x, y, z = normals.split(1, 1)
        carried = torch.cat(
            [vertices[self._used], z + float(surface.BEHIND), -y, x, light, gloss], 1
        )
        ridden = (self._shares[..., None] * carried[self._anchors]).sum(1)
        colors = (self._reflected * ridden[:, 6:9] + ridden[:, 9:]).clamp(0, 1).sqrt()
        quats = torch.nn.functional.pad(ridden[:, 3:6], (0, 1))
        areas = torch.nn.functional.pad(area, (0, 1), value=1.0)[self._follows]
        follow = (areas / self._rest_areas).sqrt().clamp(*map(float, surface.STRETCH))
        return ridden[:, :3], quats, self._widths * follow[:, None], colors

    def _received(self, normals: Tensor, gains: Tensor) -> Tensor:  # [n, 3], [n, 3] -> [n, 8]
        """See `render.lighting.Lighting.parts`."""
        cosines = normals @ self._towards
        sky = torch.addcmul(self._sky[:, 1], normals[:, 1:2], self._sky[:, 0])
        lamps = cosines[:, :3, None] * self._lamps[..., 0] + self._lamps[..., 1]
        fill, rim, key = lamps.clamp(min=0).unbind(1)
        sheen = cosines[:, 3:].clamp(min=0.5) ** 16
        return torch.cat([gains * (sky + fill + rim), gains * key, sheen, sheen**4], 1)


class TorchBeard:
    """See `render/beard.py`."""

    def __init__(self, beard: Beard, device: torch.device) -> None:
        self._corners = torch.tensor(beard.corners.astype(np.int64), device=device)
        parts = beard.shares[:, 1:], beard.offsets, beard.along
        shares, offsets, along = (torch.tensor(x, device=device) for x in parts)
        self._shares, self._parts = shares, torch.stack([offsets, along], 1)

    def stand(self, vertices: Tensor) -> tuple[Tensor, Tensor]:  # [V, 3] -> [B, 3] mm, [B, 4]
        a, b, c = vertices[self._corners].unbind(1)
        b, c = b - a, c - a
        first = torch.nn.functional.normalize(b, dim=1)
        normal = torch.nn.functional.normalize(torch.linalg.cross(b, c), dim=1)
        frame = torch.stack([first, torch.linalg.cross(normal, first), normal], 1)
        offsets, along = (self._parts @ frame).unbind(1)
        x, y, z = along.split(1, 1)
        means = a + self._shares[:, :1] * b + self._shares[:, 1:] * c + offsets
        return means, torch.cat([float(surface.BEHIND) + x, torch.zeros_like(x), -z, y], 1)
