# SPDX-License-Identifier: Apache-2.0
"""One shot from parts that were fitted apart, each lobe keeping its identity across the seams.

A lobe of one part is the lobe of the next that sends the same light. What a pairing costs is light
times the square of how far it has to be carried, over the frames that both parts have:

    c_ij = mean over frames of  min(p_i, p_j) d_ij^2 + |p_i - p_j|
    d_ij^2 = sum over both axes of (tilt / unit)^2 + mean of (ln((s_i + 1/2) / (s_j + 1/2)) / 2)^2
    unit = max(10 degrees, half of sigma at s + 1/2 = sqrt((s_i + 1/2) (s_j + 1/2)))

p are shares of the frame's flux. The unit is all of the light, carried by 10 degrees, or by half of
its own width where that is more, along each axis: a band along the horizon is the same light when
it points elsewhere along it. A factor e in width counts as that much. Light without a counterpart
is put out or lit, for 1: a lobe that stays alone costs its share. Pairing saves p_i + p_j - c_ij,
which is min(p_i, p_j) (2 - d_ij^2), and the assignment with the largest sum is taken.

Over the frames that both parts have, a pair goes over from one to the other evenly in time: flux
linearly, so that every frame has the flux of the blend; frame and sharpness as in motion.py. A lit
pair that would have to turn too far is faded out and in as two tracks. Where such a track is dark
before or after it may be another lobe: dark lobes turn unseen.

Dimension letters: F, G frames, K frames in both parts, N, M lobes.
"""

import itertools
from collections.abc import Sequence
from dataclasses import replace
from typing import Literal, NamedTuple

import torch
from torch import Tensor

from asglight.errors import InputError
from asglight.lobes import asg
from asglight.lobes.data import Form, Lobes, LobeTracks, combined, first_unused, lobe_names
from asglight.lobes.frames import align, between, continuous
from asglight.lobes.motion import exact, mixed

CARRIED_DEG = 10.0
"""How far light is carried for the price of putting it out or lighting it."""

CARRIED_SIGMA = 0.5
"""The same in standard deviations of the lobe, where that is further. With none, parts with one
preroll lose 10 of 60 lobes at the seams of `day` and `handheld`, with a half or a whole 3. Parts
fitted from nothing share few lobes; with a whole their irr is a fifth larger than with a half."""

CARRIED_LOG = 2.0
"""The same as a factor on sharpness, its logarithm: e in width."""

BROAD = 0.5
"""Added to sharpness there, as in a fit (loss/coordinates.py): below it all lobes look alike."""

TURN_MAX_DEG = 9.95
"""A lit lobe turns by less from frame to frame. Beyond 10 degrees is a jump; the rest is more than
float32 loses, and a fit, which lets lobes turn by 9.9, passes."""

LIT_SHARE = 0.01
"""Share of the flux above which a turn beyond that is a jump."""

DARK_SHARE = 1e-4
"""Share of the flux below which nobody sees a lobe move, as in a fit (fitting/loss/temporal.py)."""


class _Seam(NamedTuple):
    """Two neighbouring parts, of which the last and the first K frames are the same.

    Attributes:
        before: Lobes of the earlier part.  [F, N, .]
        after: Lobes of the later part.  [G, M, .]
        overlap: K.
    """

    before: Lobes
    after: Lobes
    overlap: int


class _Row(NamedTuple):
    """One track of the two parts together: its lobe in each, and which one gives the place."""

    before: int | None
    after: int | None
    leader: Literal["before", "after"] | None = None


def stitched(parts: Sequence[LobeTracks], names: Sequence[str] | None = None) -> LobeTracks:
    """Join parts of a shot.

    Args:
        parts: In any order. Neighbours have frames in common or follow each other.
        names: What to call them in a message; by their frames without.

    Returns:
        The tracks in float32, with the metadata of the part that begins first. The lobes of that
        part come first, in its order and under its names. Those that come later keep theirs, where
        no other has it.

    Raises:
        InputError: There is no part, or they do not make up a shot.
    """
    if not parts:
        raise InputError("parts: none; expected at least one.")
    named = list(zip(parts, names or [_range(part.frames) for part in parts], strict=True))
    named.sort(key=lambda pair: pair[0].frames[0])
    _check_alike(named)
    first, _ = named[0]
    frames, lobes = first.frames, exact(first.lobes)
    called, shown = first.names, dict(first.display_names)
    unused = first_unused(name for part in parts for name in part.names)
    for (_, name), (part, next_name) in itertools.pairwise(named):
        overlap = _overlap(frames, part.frames, f"{name} and {next_name}", _step(parts))
        seam = _Seam(lobes, exact(part.lobes), overlap)
        rows = _rows(seam)
        lobes = _joined(seam, rows)
        frames = (*frames, *part.frames[overlap:])
        called = _names(called, part.names, rows, unused)
        for name, row in zip(called, rows, strict=True):
            own = "" if row.after is None else part.names[row.after]
            if own in part.display_names:
                shown.setdefault(name, part.display_names[own])
    lobes = continuous(lobes).to(torch.float32)
    return LobeTracks(frames, first.fps, lobes, first.metadata, called, shown)


def _range(frames: Sequence[int]) -> str:
    return f"{frames[0]}-{frames[-1]}" if len(frames) > 1 else f"{frames[0]}"


def _step(parts: Sequence[LobeTracks]) -> int:
    """Return the distance between neighbouring frames; 1 where no part has two."""
    steps = [b - a for part in parts for a, b in itertools.pairwise(part.frames)]
    return min(steps, default=1)


def _check_alike(named: Sequence[tuple[LobeTracks, str]]) -> None:
    for (part, name), (other, other_name) in itertools.pairwise(named):
        if part.fps != other.fps:
            raise InputError(
                f"{other_name}: {other.fps:g} fps, but {name} has {part.fps:g}; expected parts of "
                "one rate. Fit them with the same --fps."
            )
        if part.lobes.form is not other.lobes.form:
            raise InputError(
                f"{other_name}: lobes of form {other.lobes.form}, but {name} has "
                f"{part.lobes.form}; expected one form. Fit the parts with the same --form."
            )
        if part.frames[0] == other.frames[0] or part.frames[-1] >= other.frames[-1]:
            raise InputError(
                f"{other_name}: frames {_range(other.frames)} beside {_range(part.frames)} of "
                f"{name}; expected parts of which each begins and ends after the one before. "
                "Leave one of the two out."
            )


def _overlap(frames: Sequence[int], following: Sequence[int], names: str, step: int) -> int:
    """Return how many frames both have.

    Raises:
        InputError: Frames are missing between them, or they differ where they overlap.
    """
    if following[0] - frames[-1] > step:
        gap = _range(range(frames[-1] + step, following[0], step))
        raise InputError(
            f"{names}: between them frames are missing ({gap}); expected parts that follow each "
            "other or overlap. Fit those frames too."
        )
    overlap = sum(frame >= following[0] for frame in frames)
    if tuple(frames[len(frames) - overlap :]) != tuple(following[:overlap]):
        raise InputError(
            f"{names}: different frames in {following[0]}-{frames[-1]}, where they overlap; "
            "expected the same ones. Fit them with frames of one sequence."
        )
    return overlap


def _names(
    called: tuple[str, ...], own: Sequence[str], rows: Sequence[_Row], unused: int
) -> tuple[str, ...]:
    """Return the names of the tracks of both parts together.

    Args:
        called: Those of the earlier part, which stay.
        own: Those of the later part.
        rows: The tracks.
        unused: A number from which on no part has names of lobes.
    """
    unused = max(unused, first_unused(called))
    for row in rows[len(called) :]:
        name = own[row.after or 0]
        if name in called:  # of another light
            (name,), unused = lobe_names(1, unused), unused + 1
        called = (*called, name)
    return called


def _joined(seam: _Seam, rows: Sequence[_Row]) -> Lobes:
    """Return the lobes of both parts: N and those without a place there.  [F + G - K, ., .]."""
    before, after, overlap = _paired(seam, rows)
    start = len(before.axes) - overlap
    pieces = [before[:start], _blend(before[start:], after[:overlap]), after[overlap:]]
    return combined(pieces, torch.cat)


def _blend(before: Lobes, after: Lobes) -> Lobes:
    """Go over from one to the other evenly in time.  Two [K, N, .] -> [K, N, .]."""
    after = align(after, before)
    part = _parts_of(after)[..., None]
    sharpness = torch.lerp(before.sharpness.log(), after.sharpness.log(), part).exp()
    slant = mixed(before.slant, after.slant, part)
    blend = replace(before, axes=_blended_axes(before, after), sharpness=sharpness, slant=slant)
    flux = torch.lerp(asg.flux(before), asg.flux(after), part)
    return replace(blend, amplitude=flux / asg.integral(blend)[..., None])


def _blended_axes(before: Lobes, after: Lobes) -> Tensor:
    """Return the frames of the blend of aligned lobes.  Two [K, ..., N, .] -> [K, ..., N, 3, 3]."""
    return between(before.axes, after.axes, _parts_of(after))


def _parts_of(lobes: Lobes) -> Tensor:
    """Return how far each of K frames has gone over to the later part.  [K, 1, ...]."""
    count = len(lobes.axes)
    part = torch.arange(1, count + 1, dtype=torch.float64) / (count + 1)
    return part.reshape(-1, *[1] * (lobes.axes.ndim - 3))


def _paired(seam: _Seam, rows: Sequence[_Row]) -> _Seam:
    """Give every lobe its counterpart: the same lobe, one that is dark there, or a black one.

    Over the overlap a dark or black counterpart lies where the lit lobe does, so that the two blend
    to that lobe with a part of its light.
    """
    before, after, overlap = seam
    kept = torch.tensor([row.before is not None for row in rows])
    comes = torch.tensor([row.after is not None for row in rows])
    follows = torch.tensor([row.leader == "after" for row in rows])
    leads = torch.tensor([row.leader == "before" for row in rows])
    before = before.select(torch.tensor([row.before or 0 for row in rows]))
    after = after.select(torch.tensor([row.after or 0 for row in rows]))
    led_before = _led(before, after, overlap, follows, ~kept)
    led_after = _reversed(_led(_reversed(after), _reversed(before), overlap, leads, ~comes))
    return _Seam(led_before, led_after, overlap)


def _rows(seam: _Seam) -> list[_Row]:
    """Return the tracks of both parts together, those of the earlier part in its order."""
    before, after, overlap = seam
    same = _goes_on_as(seam)
    ended = [i for i in range(before.count) if i not in same]
    begun = [j for j in range(after.count) if j not in same.values()]
    # two dark frames beside the overlap, between which the lobe turns
    dark_before = _is_dark(before[max(len(before.axes) - overlap - 2, 0) :])
    dark_after = _is_dark(after[: overlap + 2])
    idle = [i for i in ended if dark_before[i]]
    fading = [i for i in ended if not dark_before[i]]
    spare = [j for j in begun if dark_after[j]]
    rising = [j for j in begun if not dark_after[j]] + spare[len(fading) :]
    rows = [_Row(i, j) for i, j in same.items()]
    rows += [_Row(i, j, "before") for i, j in itertools.zip_longest(fading, spare[: len(fading)])]
    rows += [
        _Row(i, j, "before" if j is None else "after")
        for i, j in itertools.zip_longest(idle, rising)
    ]
    return sorted(rows, key=lambda row: before.count if row.before is None else row.before)


def _led(own: Lobes, other: Lobes, overlap: int, led: Tensor, black: Tensor) -> Lobes:
    """Lay dark lobes where their counterparts in the later part will be, flux as it was.

    Args:
        own: The earlier part.  [F, N, .]
        other: The later part.  [G, N, .]
        overlap: K.
        led: Which lobes: from the frame before the overlap on.  [N]
        black: Those that have no light at all: in every frame.  [N]
    """
    count = len(own.axes)
    frame = torch.arange(count)
    there = other[(frame - (count - overlap)).clamp(min=0, max=len(other.axes) - 1)]
    moved = (led & (frame >= count - overlap - 1)[:, None]) | black  # [F, N]
    flux = torch.where(black[:, None], 0.0, asg.flux(own))
    laid = replace(
        own,
        axes=torch.where(moved[..., None, None], there.axes, own.axes),
        sharpness=torch.where(moved[..., None], there.sharpness, own.sharpness),
        slant=mixed(own.slant, there.slant, moved[..., None].to(own.sharpness)),
    )
    amplitude = torch.where(moved[..., None], flux / asg.integral(laid)[..., None], own.amplitude)
    return replace(laid, amplitude=amplitude)


def _reversed(lobes: Lobes) -> Lobes:
    return lobes[torch.arange(len(lobes.axes) - 1, -1, -1)]


def _goes_on_as(seam: _Seam) -> dict[int, int]:
    """Return which lobe of the later part each lobe of the earlier one goes on as."""
    before, after, overlap = seam
    count = max(overlap, 1)  # parts that only touch are compared across the seam
    last, first = before[len(before.axes) - count :], after[:count]
    return pairs_that_save(torch.where(_jumps(seam), 0.0, light_saved(last, first).mean(0)))


def pairs_that_save(saved: Tensor) -> dict[int, int]:
    """Return the pairs that save most together, without those that save nothing.

    Args:
        saved: What each pair saves, by `light_saved`.  [N, M]
    """
    from scipy.optimize import linear_sum_assignment  # a third of a second to load

    saved = saved.clamp(min=0)
    rows, columns = linear_sum_assignment(saved.numpy(), maximize=True)
    pairs = zip(rows.tolist(), columns.tolist(), strict=True)
    return {i: j for i, j in pairs if float(saved[i, j]) > 0}


def light_saved(before: Lobes, after: Lobes) -> Tensor:
    """Return what pairing every lobe with every other saves: min(p_i, p_j) (2 - d_ij^2).

    Args:
        before: Lobes of K frames.  [K, N, .]
        after: Others of the same frames, of the same form.  [K, M, .]

    Returns:
        Shares of the flux, negative where carrying costs more.  [K, N, M]
    """
    lobes, others = _all_pairs(before, after)
    widths = ((others.sharpness + BROAD) / (lobes.sharpness + BROAD)).log() / CARRIED_LOG
    distance = _tilt(lobes, others) + widths.square().mean(-1)
    return torch.minimum(*shares(before, after)) * (2 - distance)


def _tilt(lobes: Lobes, others: Lobes) -> Tensor:
    """Return how far light is carried between aligned lobes, squared, in units of each axis.

    [..., N, .] twice -> [..., N].
    """
    chord = others.axis_z - lobes.axis_z
    along_x = (chord * (lobes.axis_x + others.axis_x)).sum(-1)
    along_y = (chord * (lobes.axis_y + others.axis_y)).sum(-1)
    along = torch.stack([along_x, along_y], dim=-1).square()
    whole = along.sum(-1, keepdim=True)
    # straight behind each other lobes have no plane between them; any is as good
    parts = torch.where(whole > 0, along / whole.clamp(min=torch.finfo(along.dtype).tiny), 0.5)
    factor = asg.per_variance(lobes.form)  # 1 / E[x^2] for one of sharpness
    sharpness = ((lobes.sharpness + BROAD) * (others.sharpness + BROAD)).sqrt()
    sigma = torch.rad2deg((factor * sharpness).rsqrt())
    unit = (CARRIED_SIGMA * sigma).clamp(min=CARRIED_DEG)
    turn = _turn_deg(lobes, others)[..., None]
    return (parts * (turn / unit).square()).sum(-1)


def _jumps(seam: _Seam) -> Tensor:
    """Tell which pairs would turn too far while lit: into the overlap, in it, or out.  [N, M]."""
    before, after, overlap = seam
    last = before[len(before.axes) - overlap - 1 :]  # K + 1 frames, as of the later part
    lobes, others = _all_pairs(last, after[: overlap + 1])
    share, other_share = shares(last, after[: overlap + 1])
    lit = torch.cat([share[:1], torch.maximum(share[1:], other_share[:-1]), other_share[-1:]])
    lit = torch.maximum(lit[:-1], lit[1:]) > LIT_SHARE
    over = _blended_axes(lobes[1:], align(others[:-1], lobes[1:]))
    axes = torch.cat([lobes.axes[:1], over, others.axes[-1:]])
    path = replace(lobes, axes=axes[:-1]), replace(lobes, axes=axes[1:])
    return ((_turn_deg(*path) > TURN_MAX_DEG) & lit).any(0)


def _all_pairs(before: Lobes, after: Lobes) -> tuple[Lobes, Lobes]:
    """Hold every lobe beside every other, their frames aligned.  Two [K, N, M, .]."""
    size = (len(before.axes), before.count, after.count)
    first = before.each(lambda own: own[:, :, None].expand(*size, *own.shape[2:]))
    second = after.each(lambda own: own[:, None].expand(*size, *own.shape[2:]))
    return first, align(second, first)


def shares(before: Lobes, after: Lobes) -> tuple[Tensor, Tensor]:
    """Return the flux shares of the lobes of every pair.  Two [K, N, M]."""
    first, second = _share(before), _share(after)
    size = (len(first), before.count, after.count)
    return first[:, :, None].expand(size), second[:, None].expand(size)


def _share(lobes: Lobes) -> Tensor:
    """Return each lobe's share of its frame's flux; zeros where all is dark.  [F, N]."""
    flux = asg.flux(lobes).sum(-1)
    return flux / flux.sum(-1, keepdim=True).clamp(min=torch.finfo(flux.dtype).tiny)


def _turn_deg(lobes: Lobes, others: Lobes) -> Tensor:
    """Return the angle between the directions of lobes, of bingham ones between their lines."""
    chord = (lobes.axis_z - others.axis_z).norm(dim=-1)
    if lobes.form is Form.BINGHAM:
        chord = torch.minimum(chord, (lobes.axis_z + others.axis_z).norm(dim=-1))
    return 2 * torch.rad2deg(torch.asin((chord / 2).clamp(max=1)))


def _is_dark(lobes: Lobes) -> list[bool]:
    """Tell which lobes nobody sees in any of the frames.  [N]."""
    return (_share(lobes) < DARK_SHARE).all(0).tolist()
