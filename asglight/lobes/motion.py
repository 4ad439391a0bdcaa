# SPDX-License-Identifier: Apache-2.0
"""Lobe tracks in continuous time: what a lobe is between two frames.

With s in [0, 1] from one frame to the next, a lobe has

    flux         (1 - s) Phi_0 + s Phi_1, in each channel
    sharpness    exp((1 - s) log s_0 + s log s_1), along each axis
    frame        its direction goes evenly along the great circle, and it turns evenly about that
    slant        (1 - s) l_0 + s l_1, of keys

and the amplitude is the flux over the integral of the unit lobe. Amplitude and sharpness are not
interpolated by themselves: their product would be a flux between the frames that neither has.

A lobe that is black in one of two frames has the other's sharpness and slant between them, and
turns as any other: its black frame says where it comes from, or goes to, while it fades
(fading.py). Before the first frame and after the last, lobes are those of that frame.

Dimension letters: T times, F frames, N lobes.
"""

from collections.abc import Sequence
from dataclasses import replace

import torch
from torch import Tensor

from asglight.lobes import asg, frames
from asglight.lobes.data import Form, Lobes, LobeTracks, chosen


def at(tracks: LobeTracks, times: Sequence[float]) -> Lobes:
    """Return the lobes of tracks at any times.

    At a frame they are those of the frame.

    Args:
        tracks: Lobes of F frames.
        times: In frame numbers; fractions lie between frames.

    Returns:
        Lobes in float64 on the CPU.  [T, N, .]
    """
    lobes = exact(tracks.lobes)
    numbers = torch.tensor(tracks.frames, dtype=torch.float64)
    time = torch.tensor(list(times), dtype=torch.float64).clamp(numbers[0], numbers[-1])
    before = (torch.searchsorted(numbers, time, right=True) - 1).clamp(0, len(numbers) - 1)
    after = (before + 1).clamp(max=len(numbers) - 1)
    span = (numbers[after] - numbers[before]).clamp(min=1)  # 0 at the last frame alone
    part = ((time - numbers[before]) / span)[:, None]
    first = lobes[before]
    return between(first, frames.align(lobes[after], first), part)


def between(
    first: Lobes, last: Lobes, part: Tensor, known: tuple[Tensor, Tensor] | None = None
) -> Lobes:
    """Return the lobes between two frames.

    Args:
        first: Of the one frame, in float64.  [..., N, .]
        last: Of the other, with the equal axes that are nearest to the first's
            (`frames.align`, `frames.continuous`).  [..., N, .]
        part: How far, from 0 to 1; at both ends the lobes are the frame's own.  [..., N] or what
            broadcasts to it
        known: The flux of both, where it is there.  [..., N, 3] each
    """
    start, end = shapes(first, last)
    part = part.to(first.amplitude).expand(first.amplitude.shape[:-1])
    share = part[..., None]
    first_flux, last_flux = known or (asg.flux(first), asg.flux(last))
    flux = (1 - share) * first_flux + share * last_flux
    sharpness = torch.exp((1 - share) * start.sharpness.log() + share * end.sharpness.log())
    moved = replace(
        first,
        axes=_axes_between(start, end, part),
        sharpness=sharpness,
        amplitude=torch.ones_like(flux),
        slant=mixed(start.slant, end.slant, share),
    )
    moved = replace(moved, amplitude=flux / asg.integral(moved)[..., None])
    return chosen(part == 0, first, chosen(part == 1, last, moved))


def shapes(first: Lobes, last: Lobes) -> tuple[Lobes, Lobes]:
    """Return lobes of two frames with the sharpness between which they are interpolated.

    It is their own, but for a lobe that is black in one frame only: it has the other's.

    Args:
        first: Of the one frame.  [..., N, .]
        last: Of the other.  [..., N, .]
    """
    first_is_black, last_is_black = is_black(first), is_black(last)
    appears = (first_is_black & ~last_is_black)[..., None]
    vanishes = (last_is_black & ~first_is_black)[..., None]
    return _shaped(appears, first, last), _shaped(vanishes, last, first)


def is_black(lobes: Lobes) -> Tensor:
    """Tell which lobes send no light.  [..., N]."""
    return (lobes.amplitude <= 0).all(-1)


def exact(lobes: Lobes) -> Lobes:
    """Return lobes in float64 on the CPU, their frames orthonormal."""
    lobes = lobes.to("cpu", torch.float64)
    return replace(lobes, axes=frames.orthonormal(lobes.axes))


def _axes_between(start: Lobes, end: Lobes, part: Tensor) -> Tensor:
    """Return frames that turn evenly.  [..., N, 3, 3].

    A lobe of the sg form has no x axis of its own; only its direction turns.
    """
    axes = end.axes
    if start.form is Form.SG:
        axes = frames.parallel_transport(start.axes, end.axis_z)
    return frames.between(start.axes, axes, part)


def _shaped(where: Tensor, lobes: Lobes, others: Lobes) -> Lobes:
    """Return lobes, where marked with the shape of others.  [..., N, 1] marks."""
    slant = mixed(lobes.slant, others.slant, where.to(lobes.sharpness))
    sharpness = torch.where(where, others.sharpness, lobes.sharpness)
    return replace(lobes, sharpness=sharpness, slant=slant)


def mixed(start: Tensor | None, end: Tensor | None, share: Tensor) -> Tensor | None:
    """Return slants between two, each number evenly; None of lobes that are no keys.  [..., N, 7].

    Args:
        start: At 0.
        end: At 1.
        share: How far.  [..., N, 1]
    """
    if start is None or end is None:
        return None
    return (1 - share) * start + share * end


def resting(lobes: Lobes) -> Lobes:
    """Give black lobes the sharpness of a frame in which they are lit: `light_of` says which.

    Args:
        lobes: A shot.  [T, N, .]
    """
    source = light_of(is_black(lobes))
    slant = None if lobes.slant is None else _taken(lobes.slant, source)
    return replace(lobes, sharpness=_taken(lobes.sharpness, source), slant=slant)


def resting_moments(lobes: Lobes) -> asg.Moments:
    """Return the moments of lobes, the black ones in the shape that they rest in.

    Args:
        lobes: A shot, float64.  [T, N, .]
    """
    source = light_of(is_black(lobes))
    own = source == torch.arange(len(source))[:, None]

    def of_all(known: Tensor) -> Tensor:
        found = known.new_zeros(*source.shape, *known.shape[1:])
        found[own] = known
        return _taken(found, source)

    return asg.Moments(*map(of_all, asg.moments(lobes[own])))


def light_of(black: Tensor) -> Tensor:
    """Tell for each sample in time which one's light it shows, if it shows any.

    A lit one shows its own. A black one goes with the sample before it, if that is lit; else with
    the next that is lit; else with the last that was.

    Args:
        black: Which samples send no light.  [T, ...]

    Returns:
        Places along T; its own where no sample is lit.  [T, ...]
    """
    count = len(black)
    own = torch.arange(count).reshape(-1, *[1] * (black.ndim - 1)).expand_as(black)
    last = torch.where(black, -1, own).cummax(0).values  # the last lit one so far; -1 for none
    following = torch.where(black, count, own).flip(0).cummin(0).values.flip(0)
    source = torch.where((following < count) & (last < own - 1), following, last)
    return torch.where(source < 0, torch.where(following < count, following, own), source)


def _taken(values: Tensor, source: Tensor) -> Tensor:
    """Pick along the first dimension.  [T, N, ...] by [T, N]."""
    index = source.reshape(*source.shape, *[1] * (values.ndim - source.ndim))
    return values.gather(0, index.expand_as(values))
