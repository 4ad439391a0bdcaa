# SPDX-License-Identifier: Apache-2.0
"""Adaptive cells, probes and J laid out as the structures of steps.h."""

from collections.abc import Sequence
from ctypes import Structure, addressof, c_double, c_float, c_int64, c_void_p
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor

from asglight.fitting.loss import coordinates, splatting, temporal
from asglight.fitting.loss.grid import Grid
from asglight.lobes import Form, asg

if TYPE_CHECKING:
    from asglight.fitting.loss import adaptive_cells as places
    from asglight.fitting.loss import lobe_images, objective
    from asglight.fitting.steps import newton

SOURCES_MAX, PRIORS_MAX = 8, 2
"""Of steps.h: probes of one grid and temporal terms of one frame, at most."""


def _pointers(*names: str) -> tuple[tuple[str, Any], ...]:
    return tuple((name, c_void_p) for name in names)


def _numbers(*names: str) -> tuple[tuple[str, Any], ...]:
    return tuple((name, c_int64) for name in names)


class Adaptive(Structure):
    """Adaptive cells of frames; `adaptive_cells` makes one."""

    _fields_ = (
        *_numbers("rows", "fine_rows", "refined_count"),
        *_pointers("cell_places", "grid_share", "splatting"),
        *_pointers("texel_places", "cell_share", "texel_share", "refined", "around"),
        *((name, c_int64 * 5) for name in ("next",)),
    )
    held: tuple[Tensor, ...]
    """What the pointers point to."""


class Probes(Structure):
    """The probes on a grid; `tables` makes one."""

    _fields_ = (
        *_numbers("rows", "sources", "waves", "views"),
        *_pointers("cosine", "sine"),
        *((name, c_int64 * SOURCES_MAX) for name in ("rings", "counts", "own_waves")),
        *((name, c_void_p * SOURCES_MAX) for name in ("filter", "view_cosine", "view_sine")),
    )
    held: tuple[Tensor, ...]
    """What the pointers point to."""


class Target(Structure):
    """J of frames; `target` makes one."""

    _fields_ = (
        *_pointers("radiance", "parts", "env_scale", "probe_scale", "view_weight"),
        *_pointers("probe_corner"),
        ("next", c_int64 * 5),
        *_numbers("part_count"),
        *((name, c_float) for name in ("env_corner", "env_weight")),
    )
    held: tuple[Tensor, ...]
    """What the pointers point to."""


class Prior(Structure):
    """A temporal term of frames."""

    _fields_ = _pointers("axes", "sharpness", "amplitude", "share", "scale")


class Lit(Structure):
    """Lobes of frames on their adaptive cells; `lit` makes one."""

    _fields_ = _pointers("axes", "sharpness", "amplitude", "values", "gaussian", "scale")
    held: tuple[Tensor, ...]
    """What the pointers point to."""


class Steps(Structure):
    """What the steps of one call have in common; `steps` makes one."""

    _fields_ = (
        *_pointers("adaptive", "target", "probes", "cell_probes", "cell_places", "cell_share"),
        *_pointers("still"),
        ("bounds", c_float * 5),
        ("priors", Prior * PRIORS_MAX),
        *_numbers("prior_count"),
        *((f"damping_{name}", c_double) for name in ("up", "down", "min", "max")),
        *((name, c_float) for name in ("tolerance", "temporal_corner")),
    )
    held: tuple[Any, ...]
    """What the pointers point to."""


def tables(
    waves: Tensor, filters: Sequence[Tensor], views: Sequence[Tensor], own_waves: Sequence[int]
) -> Probes:
    """Lay out the probes of a grid of H rows.

    Args:
        waves: The Fourier basis of a row, cosine and sine of each frequency.  [2 (H + 1), 2 H]
        filters: Of each probe, from rows to rings by frequency.  [H + 1, H, R'] each
        views: The basis at the views of a ring of each probe.  [2 (H + 1), V] each
        own_waves: Frequencies that each probe lets through, from the lowest.
    """
    rows = waves.shape[-1] // 2
    most = max(own_waves)
    halves = [_halved(waves, most)]
    halves += [_halved(each, own) for each, own in zip(views, own_waves, strict=True)]
    laid = [_mirrored(each[:own].mT) for each, own in zip(filters, own_waves, strict=True)]
    # a product takes the views of a ring as rows
    ring_views = [[part.mT.contiguous() for part in pair] for pair in halves[1:]]
    found = Probes(rows=rows, sources=len(filters), waves=most)
    found.views = sum(f.shape[-1] * v.shape[-1] for f, v in zip(filters, views, strict=True))
    found.cosine, found.sine = (part.data_ptr() for part in halves[0])
    for index, (own, each, seen) in enumerate(zip(own_waves, laid, ring_views, strict=True)):
        found.rings[index], found.counts[index] = filters[index].shape[-1], views[index].shape[-1]
        found.own_waves[index], found.filter[index] = own, each.data_ptr()
        found.view_cosine[index], found.view_sine[index] = (part.data_ptr() for part in seen)
    found.held = (*halves[0], *laid, *(part for pair in ring_views for part in pair))
    return found


def _mirrored(filters: Tensor) -> Tensor:
    """Return what filters make of the sum and of the difference of two mirrored rows, to one half.

    Seen from the other pole a filter is the same: the other half of the rings shows the sum of both
    with the other sign of the difference.

    Args:
        filters: To rings from rows, by frequency.  [K, R', H]

    Returns:
        [K, 2, (R' + 1) / 2, (H + 1) / 2]
    """
    rings, rows = ((count + 1) // 2 for count in filters.shape[1:])
    own, mirror = filters[:, :rings, :rows], filters.flip(-1)[:, :rings, :rows]
    return torch.stack([(own + mirror) / 2, (own - mirror) / 2], dim=1).contiguous()


def _halved(waves: Tensor, count: int) -> list[Tensor]:
    """Return the cosines and sines of the first frequencies over the first half of a row."""
    half = waves[: 2 * count, : waves.shape[-1] // 2 + 1]
    return [half[0::2].contiguous(), half[1::2].contiguous()]


def adaptive_cells(places: "places.AdaptiveCells") -> Adaptive:
    """Lay out the adaptive cells of frames."""
    cells = places.cells
    shared = (
        cells.monomials[1:4],
        cells.share,
        splatting.weights(places.fine_rows // places.rows, "cpu"),
    )
    own = _frames(
        places.monomials[:, 1:4],
        *(places.cell_share, places.texel_share, places.refined, places.around),
    )
    found = Adaptive(
        *(places.rows, places.fine_rows, places.refined.shape[-1]),
        *(each.data_ptr() for each in (*shared, *own)),
        _next(own),
    )
    found.held = (*shared, *own)
    return found


def target(frame: "objective.Target", corners: Tensor) -> Target:
    """Lay out J of frames.

    Args:
        frame: The maps.
        corners: phi's corner of each probe, of its scale.
    """
    own = _frames(
        *(frame.radiance, frame.parts, frame.env_scale, frame.probe_scale, frame.view_weight)
    )
    found = Target(
        *(each.data_ptr() for each in (*own, corners)),
        _next(own),
        frame.parts.shape[1],
        *(frame.corners.env, frame.env_weight),
    )
    found.held = (*own, corners)
    return found


def _frames(*tensors: Tensor) -> list[Tensor]:
    """Return tensors whose frames are contiguous each; repeated ones may be one."""
    return [each if each[0].is_contiguous() else each.contiguous() for each in tensors]


def _next(tensors: Sequence[Tensor]) -> Any:
    """Return how far on the next frame of each tensor begins; one that has one has it for all."""
    return (c_int64 * 5)(*(each.stride(0) if len(each) > 1 else 0 for each in tensors))


def steps(
    given: "newton.Setting",
    cells: Grid,
    probes: tuple[Probes, Probes],
    damping: tuple[float, float, float, float],
    counts: tuple[int, int],
) -> Steps:
    """Lay out what the steps of one call have in common.

    Args:
        given: The same for newton.py.
        cells: The grid on which the matrix is summed.
        probes: On the adaptive cells' grid and on that one.
        damping: Its factors after a step that failed and one that did not, its least and largest.
        counts: F and N.
    """
    assert len(given.priors) <= PRIORS_MAX  # C reads as many as it is told of
    frame, held = given.frame, []

    def laid(tensor: Tensor, *shape: int) -> int:
        held.append(tensor.expand(*counts, *shape).contiguous())
        return held[-1].data_ptr()

    found = Steps(prior_count=len(given.priors), temporal_corner=temporal.CORNER)
    own = frame.places.compiled, frame.compiled
    found.adaptive, found.target = map(addressof, own)
    found.probes, found.cell_probes = map(addressof, probes)
    found.cell_places, found.cell_share = cells.monomials[1:4].data_ptr(), cells.share.data_ptr()
    found.bounds = _bounds(given.width_min)
    if given.still is not None:
        found.still = laid(given.still)
    for prior, each in zip(found.priors, given.priors, strict=False):
        lobes = each.lobes
        prior.axes, prior.sharpness = laid(lobes.axes, 3, 3), laid(lobes.sharpness, 2)
        prior.amplitude = laid(lobes.amplitude, 3)
        prior.share, prior.scale = laid(each.share), laid(each.scale, 8)
    found.damping_up, found.damping_down, found.damping_min, found.damping_max = damping
    found.tolerance = given.tolerance
    found.held = (*held, *own, *probes, cells)
    return found


def _bounds(width_min: float) -> Any:
    """Return the bounds of `asglight_advance`; lobes are no narrower than a sigma, radians."""
    widest, narrowest = asg.SHARPNESS_MIN, coordinates.sharpness_max(Form.ASG, width_min)
    of_step = coordinates.TILT_MAX_WIDTHS, coordinates.TILT_MAX, coordinates.SHAPE_MAX
    return (c_float * 5)(*of_step, widest, narrowest)


def lit(shown: "lobe_images.Images") -> Lit:
    """Lay out lobes on their adaptive cells."""
    lobes = shown.lobes
    own = (lobes.axes, lobes.sharpness, lobes.amplitude, shown.values, shown.gaussian, shown.scale)
    own = tuple(each.contiguous() for each in own)
    found = Lit(*(each.data_ptr() for each in own))
    found.held = own
    return found
