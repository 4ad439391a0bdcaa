# SPDX-License-Identifier: Apache-2.0
"""The dear parts of a step, compiled: the C files beside this one, called with tensors.

Each function stands for the one of the same name in lobe_images.py, objective.py, probes.py or
newton.py, which is the reference, and serves wherever this does not: on a GPU, for other forms than
asg, in float64, on grids with an odd number of rows, and where nothing was compiled.
"""

import ctypes
import platform
from collections.abc import Sequence
from ctypes import Structure, addressof, c_float, c_int64, c_void_p
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor

from asglight.fitting import splatting
from asglight.fitting.compiled.library import INTEL, NAME
from asglight.fitting.grid import Grid
from asglight.lobes import Form, Lobes

if TYPE_CHECKING:
    from asglight.fitting import leaves as places
    from asglight.fitting import objective
    from asglight.fitting import temporal as temporal_term

LANE = 8
"""Of steps.h: so many leaves are taken at a time."""

SOURCES_MAX = 8
"""Of steps.h: probes of one grid, at most."""


def _pointers(*names: str) -> tuple[tuple[str, Any], ...]:
    return tuple((name, c_void_p) for name in names)


def _numbers(*names: str) -> tuple[tuple[str, Any], ...]:
    return tuple((name, c_int64) for name in names)


class Leaves(Structure):
    """Leaves of frames; `leaves` makes one."""

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


FUNCTIONS = (
    ("asglight_images", 2, 6),
    ("asglight_slopes", 2, 8),
    ("asglight_matrix", 2, 12),
    ("asglight_sizes", 1, 9),
    ("asglight_misfit", 1, 11),
    ("asglight_probe", 1, 3),
    ("asglight_solve", 2, 8),
    ("asglight_advance", 1, 10),
    ("asglight_temporal", 2, 12),
    ("asglight_gram", 3, 3),
)
"""Of each, how many arguments are numbers, which come first, and how many are addresses."""


def load() -> ctypes.CDLL | None:
    """Return the library, or None where none was compiled or this processor cannot run it."""
    path = Path(__file__).with_name(NAME)
    ability = torch.backends.cpu.get_cpu_capability()
    if not path.is_file() or (platform.machine() in INTEL and "AVX" not in ability):
        return None
    try:
        library = ctypes.CDLL(str(path))
    except OSError:  # of another system
        return None
    for name, numbers, addresses in FUNCTIONS:
        function = getattr(library, name)
        function.argtypes = [*[c_int64] * numbers, *[c_void_p] * addresses]
        function.restype = None
    return library


LIBRARY = load()
"""None: the steps are those of torch."""


def serves(lobes: Lobes, places: "places.Leaves") -> bool:
    """Tell whether images of lobes on leaves are compiled ones."""
    return moves(lobes) and looks(lobes.axes, places)


def moves(lobes: Lobes) -> bool:
    """Tell whether steps of lobes are compiled ones."""
    return lobes.form is Form.ASG and all(
        runs_on(each) for each in (lobes.axes, lobes.sharpness, lobes.amplitude)
    )


def looks(images: Tensor, places: "places.Leaves") -> bool:
    """Tell whether J of images on leaves is compiled.

    Args:
        images: Tells where is computed, how exactly, and of how many frames.
        places: The leaves, of as many frames or of one that all share.
    """
    share = places.cell_share
    whole = places.count % LANE == 0 and places.texel.shape[-1] % LANE == 0
    return whole and len(share) in (1, len(images)) and runs_on(images) and runs_on(share)


def runs_on(tensor: Tensor) -> bool:
    """Tell whether anything compiled serves tensors of this kind."""
    return (
        LIBRARY is not None
        and tensor.device.type == "cpu"
        and tensor.is_floating_point()
        and tensor.element_size() == 4
        and not tensor.requires_grad
    )


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


def leaves(places: "places.Leaves") -> Leaves:
    """Lay out the leaves of frames."""
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
    found = Leaves(
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


def images(lobes: Lobes, places: Leaves, leaf_count: int) -> tuple[Tensor, Tensor, Tensor]:
    """Return values and gaussian [F, N, P], and scale [F, N], of `lobe_images.Images`.

    Args:
        lobes: The lobes.  [F, N, .]
        places: The leaves.
        leaf_count: P.
    """
    axes, sharpness = lobes.axes.contiguous(), lobes.sharpness.contiguous()
    frames, count = sharpness.shape[:2]
    values, gaussian = axes.new_empty(2, frames, count, leaf_count)
    scale = axes.new_empty(frames, count)
    _call("asglight_images", frames, count, axes, sharpness, places, values, gaussian, scale)
    return values, gaussian, scale


def slopes(lobes: Lobes, scale: Tensor, slope: Tensor, places: Leaves) -> tuple[Tensor, Tensor]:
    """Return `lobe_images.slopes` in float64 and `lobe_images.scale_slopes`.

    Args:
        lobes: The lobes.  [F, N, .]
        scale: Of their images.  [F, N]
        slope: dJ / d radiance.  [F, 3, P]
        places: The leaves.

    Returns:
        [F, N, 8] and [F, N, 5].
    """
    frames, count = scale.shape
    found = slope.new_empty(frames, count, 8, dtype=torch.float64)
    of_scale = slope.new_empty(frames, count, 5)
    given = _contiguous(lobes.axes, lobes.sharpness, lobes.amplitude, scale)
    _call("asglight_slopes", frames, count, *given, places, slope.contiguous(), of_scale, found)
    return found, of_scale


def matrix(
    lobes: Lobes,
    scales: tuple[Tensor, Tensor],
    places: Leaves,
    cells: Grid,
    probes: Probes,
    weights: tuple[Tensor, Tensor],
) -> Tensor:
    """Return the matrix of `newton.normal_equations`.

    Args:
        lobes: The lobes.  [F, N, .]
        scales: `scale` of their images [F, N] and `scale_slopes` [F, N, 5].
        places: The leaves.
        cells: The grid on which the matrix is summed.
        probes: On that grid.
        weights: Of leaves [F, P] and views [F, D], from `objective.Misfit`.

    Returns:
        H in float64.  [F, 8 N, 8 N]
    """
    frames, count = scales[0].shape
    found = lobes.axes.new_empty(frames, 8 * count, 8 * count, dtype=torch.float64)
    given = _contiguous(lobes.axes, lobes.sharpness, lobes.amplitude, *scales)
    on_cells = cells.monomials[1:4], cells.share
    _call(
        *("asglight_matrix", frames, count, *given, places, probes),
        *(*on_cells, *_contiguous(*weights), found),
    )
    return found


def sizes(
    radiance: Tensor, places: Leaves, frame: Target, probes: Probes
) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor]:
    """Return what `objective.Sizes` holds.

    Args:
        radiance: Reconstructions on the leaves.  [F, 3, P]
        places: The leaves.
        frame: The maps.
        probes: On the leaves' grid.
    """
    frames, count = len(radiance), 2 * places.rows**2
    found = (
        radiance.new_empty(frames),
        radiance.new_empty(frames, frame.part_count, count),
        radiance.new_empty(frames, radiance.shape[-1] - count),
        radiance.new_empty(frames, 3, probes.views),
        radiance.new_empty(frames, probes.views),
    )
    _call("asglight_sizes", frames, places, frame, probes, radiance.contiguous(), *found)
    return found


def misfit(
    radiance: Tensor, found: "objective.Sizes", places: Leaves, frame: Target, probes: Probes
) -> tuple[Tensor, Tensor, Tensor]:
    """Return slope, env_weight and view_weight of `objective.Misfit`.

    Args:
        radiance: Reconstructions on the leaves.  [F, 3, P]
        found: Their sizes.
        places: The leaves.
        frame: The maps.
        probes: On the leaves' grid.
    """
    radiance = radiance.contiguous()
    slope = torch.empty_like(radiance)
    env_weight = radiance.new_empty(len(radiance), radiance.shape[-1])
    view_weight = radiance.new_empty(len(radiance), probes.views)
    given = _contiguous(found.parts, found.texels, found.views, found.seen)
    _call(
        *("asglight_misfit", len(radiance), places, frame, probes, radiance, *given),
        *(slope, env_weight, view_weight),
    )
    return slope, env_weight, view_weight


def probe(images: Tensor, probes: Probes) -> Tensor:
    """Return `probes.probe` of images on its grid.  [..., P] -> [..., D]."""
    views = images.new_empty(*images.shape[:-1], probes.views)
    _call("asglight_probe", views.numel() // probes.views, probes, images.contiguous(), views)
    return views


def weighted_gram(images: Tensor, weight: Tensor) -> Tensor:
    """Return `light._weighted_gram` of images [F, N, P] and weights [F, P]."""
    frames, count, leaf_count = images.shape
    found = images.new_empty(frames, count, count, dtype=torch.float64)
    _call("asglight_gram", frames, count, leaf_count, *_contiguous(images, weight), found)
    return found


def solve(
    hessian: Tensor,
    gradient: Tensor,
    lobes: Lobes,
    damping: Tensor,
    still: Tensor | None,
    sharpness_min: float,
) -> Tensor:
    """Return the step of `newton._solve`.

    Args:
        hessian: H.  [F, 8 N, 8 N]
        gradient: g.  [F, 8 N]
        lobes: The lobes.  [F, N, .]
        damping: Of each frame.  [F]
        still: Which lobes stay as they are.  [F, N]
        sharpness_min: A lobe's least sharpness.

    Returns:
        In float64.  [F, N, 8]
    """
    frames, count = lobes.sharpness.shape[:2]
    found = gradient.new_empty(frames, count, 8)
    given = _contiguous(hessian, gradient, lobes.sharpness, lobes.amplitude, damping)
    stays = 0 if still is None else still.contiguous()
    _call("asglight_solve", frames, count, *given, stays, _floats(sharpness_min), found)
    return found


def advance(
    lobes: Lobes, step: Tensor, bounds: tuple[float, ...], leash: tuple[Tensor, Tensor] | None
) -> Lobes:
    """Return the lobes of `coordinates.advance`.

    Args:
        lobes: The lobes.  [..., N, .]
        step: In local coordinates.  [..., N, 8]
        bounds: Of a tilt in widths and in radians, of widths and turn, of sharpness twice.
        leash: Where lobes were [..., N, 3] and the cosine of how far they may go [..., N].
    """
    given = _contiguous(lobes.axes, lobes.sharpness, lobes.amplitude)
    found = [torch.empty_like(each) for each in given]
    count = given[1].numel() // 2
    own = [0, 0]
    if leash is not None:
        shapes = given[1].shape[:-1]
        own = _contiguous(leash[0].expand(*shapes, 3), leash[1].expand(shapes))
    _call(
        *("asglight_advance", count, *given, step.double().contiguous(), _floats(*bounds)),
        *(*own, *found),
    )
    axes, sharpness, amplitude = found
    return Lobes(axes, sharpness, amplitude, lobes.form)


def temporal(lobes: Lobes, held: "temporal_term.Prior", corner: float) -> tuple[Tensor, ...]:
    """Return `temporal.value` [F], and both of `temporal.slopes` [F, 8 N].

    Args:
        lobes: The lobes.  [F, N, .]
        held: Where they were.
        corner: Below it ways count by their square.
    """
    frames, count = lobes.sharpness.shape[:2]
    found = (
        lobes.axes.new_empty(frames),
        *lobes.axes.new_empty(2, frames, 8 * count, dtype=torch.float64),
    )
    own = (lobes.axes, lobes.sharpness, lobes.amplitude)
    before = (held.lobes.axes, held.lobes.sharpness, held.lobes.amplitude, held.share, held.scale)
    then = [each.expand(frames, *each.shape[1:]) for each in before]
    _call(
        *("asglight_temporal", frames, count, *_contiguous(*own, *then)),
        *(_floats(corner), *found),
    )
    return found


def _call(name: str, *arguments: Tensor | Structure | int) -> None:
    """Call a function with where tensors and structures begin, and numbers."""
    given = [
        each.data_ptr()
        if isinstance(each, Tensor)
        else each
        if isinstance(each, int)
        else addressof(each)
        for each in arguments
    ]
    getattr(LIBRARY, name)(*given)


def _contiguous(*tensors: Tensor) -> list[Tensor]:
    return [each.contiguous() for each in tensors]


def _frames(*tensors: Tensor) -> list[Tensor]:
    """Return tensors whose frames are contiguous each; repeated ones may be one."""
    return [each if each[0].is_contiguous() else each.contiguous() for each in tensors]


def _next(tensors: Sequence[Tensor]) -> Any:
    """Return how far on the next frame of each tensor begins; one that has one has it for all."""
    return (c_int64 * 5)(*(each.stride(0) if len(each) > 1 else 0 for each in tensors))


@lru_cache(maxsize=64)
@torch.inference_mode(False)
def _floats(*numbers: float) -> Tensor:
    """Return numbers where the library can read them."""
    return torch.tensor(numbers, dtype=torch.float32)
