"""The eye encoder's networks: where the eye lies in a picture, its features, gaze and lid.

EyeFinder: a camera's picture -> where the eye lies. EyeNet: the picture framed by that -> 80
features, gaze, lid opening, validity. EyeMeter: the same picture -> is there an eye, lid, gaze and
its doubt, for cameras and wearers far from those that the features were learned of.

Both eyes share the weights: the right eye's picture and gaze are mirrored, so the network only ever
sees left eyes. Frame by frame, no memory. Paper section 5.2 takes its features from a facial
encoder (Bai et al. 2024); here they are the last hidden layer of a small network that was trained
on the capture stage's renders to tell gaze, lid and the upper face's rig channels.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn

from encoder.eyes.format import FOUND, GAZE_UNIT, MEASURES, RIG, SIDE, EyeNetConfig

FINDER_WIDTH = 64


def _convolutions(config: EyeNetConfig) -> tuple[nn.ModuleList, nn.ModuleList, int]:
    """Down to 7 x 7; and how many numbers come out."""
    channels, side = 1, SIDE
    convs, norms = nn.ModuleList(), nn.ModuleList()
    for width, kernel, stride in config.layers:
        convs.append(nn.Conv2d(channels, width, kernel, stride, kernel // 2, bias=False))
        norms.append(nn.BatchNorm2d(width))
        channels, side = width, -(-side // stride)
    return convs, norms, channels * side * side


def _convolved(x: Tensor, convs: nn.ModuleList, norms: nn.ModuleList) -> Tensor:
    """[B, 1, n, n] -> [B, all]; a stride of 1 adds its input."""
    for conv, norm in zip(convs, norms, strict=True):
        y = norm(conv(x)).contiguous(memory_format=torch.channels_last)  # a third faster
        x = torch.relu(y + x if conv.stride == (1, 1) else y)
    return x.flatten(1)


class EyeOutputs(NamedTuple):
    """Of left-like eyes; B pictures."""

    features: Tensor  # [B, 80] in -1..1
    gaze: Tensor  # [B, 2] x and y of the unit vector, +x away from the nose, +y up
    lid: Tensor  # [B] opening: 0 shut, 1 open
    valid: Tensor  # [B] logit: is this a left eye, seen by a working camera?
    rig: Tensor  # [B, 7] RIG


class EyeFinder(nn.Module):
    """A small picture of all that a camera sees -> FOUND: is there an eye, and where."""

    def __init__(self, config: EyeNetConfig) -> None:
        super().__init__()
        first, second, third = config.finder
        self.convs = nn.ModuleList(
            [
                nn.Conv2d(1, first, 5, 2, 2, bias=False),
                nn.Conv2d(first, second, 3, 2, 1, bias=False),
                nn.Conv2d(second, second, 3, 1, 1, bias=False),
                nn.Conv2d(second, third, 3, 2, 1, bias=False),
                nn.Conv2d(third, third, 3, 1, 1, bias=False),
            ]
        )
        widths = (first, second, second, third, third)
        self.norms = nn.ModuleList(nn.BatchNorm2d(width) for width in widths)
        self.project = nn.Linear(third * 7 * 7, FINDER_WIDTH)
        self.spread = nn.BatchNorm1d(FINDER_WIDTH, affine=False)
        self.heads = nn.Linear(FINDER_WIDTH, len(FOUND))

    def forward(self, x: Tensor) -> Tensor:  # [B, 1, 50, 50] of `normalised` -> [B, 6]
        flat = _convolved(x, self.convs, self.norms)
        return self.heads(torch.relu(self.spread(self.project(flat))))


class EyeMeter(nn.Module):
    """The convolutions of EyeNet with other weights, and one layer to MEASURES."""

    def __init__(self, config: EyeNetConfig) -> None:
        super().__init__()
        self.convs, self.norms, flat = _convolutions(config)
        self.project = nn.Linear(flat, config.measure)
        self.spread = nn.BatchNorm1d(config.measure, affine=False)
        self.heads = nn.Linear(config.measure, len(MEASURES))

    def forward(self, x: Tensor) -> Tensor:  # [B, 1, 100, 100] of `normalised` -> [B, 8] raw
        flat = _convolved(x, self.convs, self.norms)
        return self.heads(torch.relu(self.spread(self.project(flat))))


class EyeNet(nn.Module):
    """Convolutions down to 7 x 7, one linear layer to the features, linear heads."""

    subject_spread: Tensor
    frame_spread: Tensor

    def __init__(self, config: EyeNetConfig) -> None:
        super().__init__()
        self.config = config
        self.convs, self.norms, flat = _convolutions(config)
        self.project = nn.Linear(flat, config.features)
        # without it one step of 2e-3 on 3136 inputs saturates the tanh, and nothing is learned
        self.spread = nn.BatchNorm1d(config.features, affine=False)
        self.heads = nn.Linear(config.features, 4 + len(RIG))
        # both eyes share one target: correction of this eye's gaze from both eyes' features
        told = nn.Linear(config.pair, 2)
        nn.init.zeros_(told.weight)
        nn.init.zeros_(told.bias)
        self.pair = nn.Sequential(nn.Linear(2 * config.features, config.pair), nn.Tanh(), told)
        # features that a gaze and a face would give: for training data and for lost cameras
        self.synthesis = nn.Sequential(
            nn.Linear(2 + len(RIG), config.synthesis),
            nn.Tanh(),
            nn.Linear(config.synthesis, config.features),
        )
        # spread of real features around it: constant per subject, and frame by frame
        self.register_buffer("subject_spread", torch.zeros(config.features, config.features))
        self.register_buffer("frame_spread", torch.zeros(config.features, config.features))
        # for pictures far from those that the features were learned of
        self.finder, self.meter = EyeFinder(config), EyeMeter(config)
        # Features -> gaze, right but for a constant of the wearer, for calibration to map: in one
        # picture a lower gaze and a higher camera look alike, so `heads` shrinks what it sees.
        self.relative = nn.Parameter(torch.zeros(config.features + 1, 2))

    def forward(self, x: Tensor) -> EyeOutputs:  # [B, 1, 100, 100] of `normalised`
        features = torch.tanh(self.spread(self.project(_convolved(x, self.convs, self.norms))))
        gaze, lid, valid, rig = self.heads(features).split([2, 1, 1, len(RIG)], 1)
        return EyeOutputs(features, gaze * GAZE_UNIT, lid[:, 0], valid[:, 0], rig)

    def together(self, features: Tensor, gaze: Tensor) -> Tensor:
        """Features [..., 2, 80] and gaze [..., 2, 2] of left-like eyes -> gaze [..., 2, 2]."""
        return gaze + GAZE_UNIT * self.pair(torch.cat([features, features.flip(-2)], -1))

    def synthesise(self, gaze: Tensor, rig: Tensor) -> Tensor:
        """gaze [..., 2] and rig [..., 7] of left-like eyes -> features [..., 80]."""
        return torch.tanh(self.synthesis(torch.cat([gaze / GAZE_UNIT, rig], -1)))
