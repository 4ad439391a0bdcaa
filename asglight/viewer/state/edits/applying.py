# SPDX-License-Identifier: Apache-2.0
"""Tracks go in, edited tracks come out; every other value is the same to the last bit."""

from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from asglight.lobes import Form, Lobes, LobeTracks, asg, frames
from asglight.lobes.data import combined, first_unused, lobe_names
from asglight.usd.write.checks import AMPLITUDE_MAX
from asglight.viewer.state.edits.absolute import level
from asglight.viewer.state.edits.edit import Add, Edit


def apply(tracks: LobeTracks, edit: Edit) -> LobeTracks:
    """Return tracks in which the light of one lobe is edited.

    Sharpness that is scaled stays within the limits of asglight.lobes.asg, amplitude below what a
    stage can hold.

    Args:
        tracks: Lobes of F frames.
        edit: What to do.

    Raises:
        ValueError: There is no such lobe or frame, or a lobe of the sg form would get two
            sharpnesses.
    """
    track = track_of(tracks, edit.lobe)
    return with_track(tracks, edit.lobe, _edited(track, edit, tracks.frames))


def track_of(tracks: LobeTracks, lobe: int) -> Lobes:
    """Return one lobe in all frames.  [F, .].

    Raises:
        ValueError: There is no such lobe.
    """
    if not 0 <= lobe < tracks.lobes.count:
        raise ValueError(f"lobe: {lobe} of {tracks.lobes.count}")
    return tracks.lobes[:, lobe]


def with_track(tracks: LobeTracks, lobe: int, track: Lobes) -> LobeTracks:
    """Return tracks in which one lobe is another one.

    Args:
        tracks: Lobes of F frames.
        lobe: Index of the lobe.
        track: What it becomes.  [F, .]
    """
    lobes = tracks.lobes.clone()
    lobes.axes[:, lobe] = track.axes
    lobes.sharpness[:, lobe] = track.sharpness
    lobes.amplitude[:, lobe] = track.amplitude
    return replace(tracks, lobes=lobes)


def with_more(tracks: LobeTracks, add: Add) -> LobeTracks:
    """Return tracks with one lobe more, the last, upright and under a name that no other has.

    Raises:
        ValueError: The lobe would not be the last.
    """
    if add.lobe != tracks.lobes.count:
        raise ValueError(f"lobe: {add.lobe} after {tracks.lobes.count}")
    old = tracks.lobes
    like = {"dtype": old.axes.dtype, "device": old.axes.device}
    upright = torch.from_numpy(np.stack([*level(np.array(add.direction)), add.direction]))
    axes = upright.to(**like).expand(len(tracks.frames), 1, 3, 3)
    sharpness = torch.full((len(tracks.frames), 1, 2), add.sharpness, **like)
    amplitude = torch.tensor(add.amplitude, **like).expand(len(tracks.frames), 1, 3)
    more = Lobes(axes, sharpness, amplitude, old.form)
    lobes = combined([old, more], lambda pair: torch.cat(pair, dim=1))
    kind = "key" if add.is_key else "lobe"
    name = lobe_names(1, first_unused(tracks.names, kind), kind)
    return replace(tracks, lobes=lobes, names=tracks.names + name)


def with_fewer(tracks: LobeTracks, count: int) -> LobeTracks:
    """Return the first so many lobes of tracks."""
    return replace(tracks, lobes=tracks.lobes.split(count)[0], names=tracks.names[:count])


def _edited(track: Lobes, edit: Edit, numbers: tuple[int, ...]) -> Lobes:
    """Edit one lobe's track [F, .]: in float64, then rounded once."""
    if track.form is Form.SG and edit.sharpness_log2[0] != edit.sharpness_log2[1]:
        raise ValueError(f"sharpness_log2: {edit.sharpness_log2}, expected equal ones for sg")
    track = track.clone()
    weights = torch.ones(len(numbers), dtype=torch.float64)
    if edit.span is not None:
        weights = edit.span.weights(numbers)
    chosen = weights > 0
    part, share = track[chosen].to(torch.float64), weights[chosen]
    if any(edit.gain_log2):
        gain = torch.exp2(share[:, None] * share.new_tensor(edit.gain_log2))
        track.amplitude[chosen] = (
            (part.amplitude * gain).clamp(max=AMPLITUDE_MAX).to(track.amplitude)
        )
    for axis, power in enumerate(edit.sharpness_log2):
        if power:
            sharpness = part.sharpness[:, axis] * torch.exp2(share * power)
            limits = asg.SHARPNESS_MIN, asg.SHARPNESS_MAX
            track.sharpness[chosen, axis] = sharpness.clamp(*limits).to(track.sharpness)
    if any(edit.rotation[1:]):
        turns = frames.axes_from_quaternion(_partial(edit.rotation, share)).mT  # [F, 3, 3]
        turned = part.axes @ turns.mT
        track.axes[chosen] = frames.orthonormal(turned).to(track.axes)
    return track


def _partial(rotation: tuple[float, ...], share: Tensor) -> Tensor:
    """Return a share of a rotation the short way, as quaternions.  [F, 4].

    Args:
        rotation: Quaternion (w, x, y, z) of any length.
        share: From 0 to 1.  [F]
    """
    quaternion = torch.nn.functional.normalize(share.new_tensor(rotation), dim=0)
    quaternion = quaternion * (1.0 if quaternion[0] >= 0 else -1.0)
    axis = torch.nn.functional.normalize(quaternion[1:], dim=0)
    half = torch.atan2(quaternion[1:].norm(), quaternion[0]) * share  # [F]
    return torch.cat([torch.cos(half)[:, None], torch.sin(half)[:, None] * axis], dim=-1)
