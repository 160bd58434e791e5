"""Brings the width of tracked lips to one size for all talkers.

Talkers differ in how wide their lips are while they speak, against rest, and in how far the width
moves: some narrow their lips, some widen them. Nobody hears that, so that a network can only learn
the mean of all; what it does hear, who is wide for s and narrow for w, is clearer without it.
"""

import numpy as np
import torch

from encoder.training.mouth import Mouth
from encoder.training.streams.spoken import REST, RULES

APART_MM = 1.0  # that lips are when a voice is heard, where phones are not known
LEAST_MM = 0.1  # of a talker's deviation: less is no movement that could be scaled


def levelled(
    truth: np.ndarray, voice: np.ndarray, speaking: np.ndarray, mouth: Mouth
) -> np.ndarray:
    """truth [N, MOUTH], voice [N] str, speaking [N] bool -> [N, MOUTH].

    The mean and the standard deviation of a tracked talker's lip width over the frames in which he
    or she speaks become the mean of all talkers'; how far lips are open stays. Elsewhere the change
    fades with the opening, so that rest stays rest.
    """
    true = torch.from_numpy(truth)
    opening, width = mouth.spans(true).numpy().astype(np.float64).T
    talkers = {
        name: width[speaking & (voice == name)]
        for name in sorted(set(voice[speaking].tolist()) - {RULES, REST})
    }
    if not talkers:
        return truth
    own = {name: (said.mean(), max(said.std(), LEAST_MM)) for name, said in talkers.items()}
    middle, spread = np.mean(list(own.values()), axis=0)
    more = np.zeros(len(truth))  # mm
    for name, (mean, deviation) in own.items():
        rows = voice == name
        more[rows] = middle + (width[rows] - mean) * spread / deviation - width[rows]
    more *= np.where(speaking, 1, np.clip(opening / APART_MM, 0, 1))
    widen = mouth.ways(true)[1].numpy()
    return truth + more[:, None].astype(np.float32) * widen
