# SPDX-License-Identifier: Apache-2.0
"""Lights that come back: dark tracks are lit again where they were, all at once.

Lamps that blink, or that a pillar hid, come back in their places. Their tracks are dark there, with
the shapes that they had. The light of all tracks, lit and dark ones, is one non-negative least
squares problem. Relocation (relocation.py) would light them one by one, each after trials.
"""

import torch
from torch import Tensor

from asglight.fitting.loss import lobe_images, objective, temporal
from asglight.fitting.loss.lobe_images import Images
from asglight.fitting.steps import light
from asglight.lobes import Lobes, asg


def lit_again(known: Lobes, frame: objective.Target, count: int) -> tuple[Tensor, Images]:
    """Solve for the light of all tracks, and again for that of the brightest.

    Args:
        known: The tracks, dark ones where they were.  [2 N, .]
        frame: The map.  F = 1
        count: Lobes lit at most.

    Returns:
        The tracks that are lit, ascending [K], and their lobes on the adaptive cells [1, K, .].
    """
    every = light.solve_amplitudes(lobe_images.images(known[None], frame.places), frame).lobes[0]
    flux = torch.where(temporal.is_dark(every), 0.0, asg.flux(every).sum(-1))
    lit = min(count, int((flux > 0).sum()))
    tracks = flux.topk(lit).indices.sort().values
    shown = lobe_images.images(every.select(tracks)[None], frame.places)
    return tracks, light.solve_amplitudes(shown, frame)
