# SPDX-License-Identifier: Apache-2.0
"""Steps and their dear parts, compiled: the C files beside this one, called with tensors.

Each function stands for the one of the same name in lobe_images.py, objective.py, probes.py,
light.py, newton.py or seeding.py, which is the reference, and serves wherever this does not: on a
GPU, for steps of other forms than asg or in float64, on grids with an odd number of rows, and where
nothing was compiled.
"""

import ctypes
import platform
from collections.abc import Callable
from ctypes import CFUNCTYPE, Structure, addressof, c_int, c_int64, c_uint32, c_void_p
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor
from torch.nn.functional import normalize, pad

from asglight.c_library import LIBRARIES, X86, fingerprint
from asglight.fitting.compiled import layout
from asglight.fitting.compiled.layout import Adaptive, Probes, Target
from asglight.fitting.loss.grid import Grid
from asglight.lobes import Form, Lobes
from asglight.threads import frame_threads

if TYPE_CHECKING:
    from asglight.fitting.first_frame.seeding import Cells
    from asglight.fitting.loss import adaptive_cells as places
    from asglight.fitting.loss import objective
    from asglight.fitting.loss.lobe_images import Images

NAME = LIBRARIES["fitting/compiled"]

LANE = 8
"""Of steps.h: so many adaptive cells are taken at a time."""

WIDE = 4
"""Of mixture.c: so many cells are."""

FUNCTIONS = (
    ("asglight_images", 2, 6),
    ("asglight_slopes", 2, 8),
    ("asglight_matrix", 2, 12),
    ("asglight_loss_terms", 1, 9),
    ("asglight_loss_gradient", 1, 11),
    ("asglight_probe", 1, 3),
    ("asglight_light", 2, 8),
    ("asglight_minimise", 3, 6),
    ("asglight_mixture", 3, 5),
)
"""Of each, how many arguments are numbers, which come first, and how many are addresses."""


REPORT = CFUNCTYPE(c_int)
"""What C calls after a step; other than 0 ends the steps."""


def load() -> ctypes.CDLL | None:
    """Return the library, or None where it cannot be used.

    It was not compiled, from other sources or for another system, or this processor is too old.
    """
    path = Path(__file__).with_name(NAME)
    ability = torch.backends.cpu.get_cpu_capability()
    if not path.is_file() or (platform.machine() in X86 and "AVX" not in ability):
        return None
    try:
        library = ctypes.CDLL(str(path))
        library.asglight_sources.restype = ctypes.c_char_p
    except (OSError, AttributeError):
        return None
    if library.asglight_sources() != fingerprint(path.parent).encode():
        return None
    library.asglight_begin.argtypes, library.asglight_begin.restype = [c_int64], c_uint32
    library.asglight_end.argtypes, library.asglight_end.restype = [c_uint32], None
    for name, numbers, addresses in FUNCTIONS:
        function = getattr(library, name)
        function.argtypes = [*[c_int64] * numbers, *[c_void_p] * addresses]
        function.restype = None
    return library


LIBRARY = load()
"""None: the steps are those of torch."""


def serves(lobes: Lobes, places: "places.AdaptiveCells") -> bool:
    """Tell whether images of lobes on adaptive cells are compiled ones."""
    return moves(lobes) and looks(lobes.axes, places)


def moves(lobes: Lobes) -> bool:
    """Tell whether steps of lobes are compiled ones."""
    return lobes.form is Form.ASG and all(
        runs_on(each) for each in (lobes.axes, lobes.sharpness, lobes.amplitude)
    )


def looks(images: Tensor, places: "places.AdaptiveCells") -> bool:
    """Tell whether J of images on adaptive cells is compiled.

    Args:
        images: Tells where is computed, how exactly, and of how many frames.
        places: The adaptive cells, of as many frames or of one that all share.
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


def mixes(weight: Tensor) -> bool:
    """Tell whether mixtures over cells of this kind are compiled ones."""
    return LIBRARY is not None and weight.device.type == "cpu" and weight.dtype == torch.float64


def images(lobes: Lobes, places: Adaptive, adaptive_count: int) -> tuple[Tensor, Tensor, Tensor]:
    """Return values and gaussian [F, N, P], and scale [F, N], of `lobe_images.Images`.

    Args:
        lobes: The lobes.  [F, N, .]
        places: The adaptive cells.
        adaptive_count: P.
    """
    axes, sharpness = lobes.axes.contiguous(), lobes.sharpness.contiguous()
    frames, count = sharpness.shape[:2]
    values, gaussian = axes.new_empty(2, frames, count, adaptive_count)
    scale = axes.new_empty(frames, count)
    _call("asglight_images", frames, count, axes, sharpness, places, values, gaussian, scale)
    return values, gaussian, scale


def slopes(lobes: Lobes, scale: Tensor, slope: Tensor, places: Adaptive) -> tuple[Tensor, Tensor]:
    """Return `lobe_images.slopes` in float64 and `lobe_images.scale_slopes`.

    Args:
        lobes: The lobes.  [F, N, .]
        scale: Of their images.  [F, N]
        slope: dJ / d radiance.  [F, 3, P]
        places: The adaptive cells.

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
    places: Adaptive,
    cells: Grid,
    probes: Probes,
    weights: tuple[Tensor, Tensor],
) -> Tensor:
    """Return the matrix of `equations.normal_equations`.

    Args:
        lobes: The lobes.  [F, N, .]
        scales: `scale` of their images [F, N] and `scale_slopes` [F, N, 5].
        places: The adaptive cells.
        cells: The grid on which the matrix is summed.
        probes: On that grid.
        weights: Of adaptive cells [F, P] and views [F, D], from `objective.LossGradient`.

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


def loss_terms(
    radiance: Tensor, places: Adaptive, frame: Target, probes: Probes
) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor]:
    """Return what `objective.LossTerms` holds.

    Args:
        radiance: Reconstructions on the adaptive cells.  [F, 3, P]
        places: The adaptive cells.
        frame: The maps.
        probes: On the adaptive cells' grid.
    """
    frames, count = len(radiance), 2 * places.rows**2
    found = (
        radiance.new_empty(frames),
        radiance.new_empty(frames, frame.part_count, count),
        radiance.new_empty(frames, radiance.shape[-1] - count),
        radiance.new_empty(frames, 3, probes.views),
        radiance.new_empty(frames, probes.views),
    )
    _call("asglight_loss_terms", frames, places, frame, probes, radiance.contiguous(), *found)
    return found


def loss_gradient(
    radiance: Tensor, terms: "objective.LossTerms", places: Adaptive, frame: Target, probes: Probes
) -> tuple[Tensor, Tensor, Tensor]:
    """Return slope, env_weight and view_weight of `objective.LossGradient`.

    Args:
        radiance: Reconstructions on the adaptive cells.  [F, 3, P]
        terms: Theirs.
        places: The adaptive cells.
        frame: The maps.
        probes: On the adaptive cells' grid.
    """
    radiance = radiance.contiguous()
    slope = torch.empty_like(radiance)
    env_weight = radiance.new_empty(len(radiance), radiance.shape[-1])
    view_weight = radiance.new_empty(len(radiance), probes.views)
    given = _contiguous(terms.parts, terms.texels, terms.views, terms.seen)
    _call(
        *("asglight_loss_gradient", len(radiance), places, frame, probes, radiance, *given),
        *(slope, env_weight, view_weight),
    )
    return slope, env_weight, view_weight


def probe(images: Tensor, probes: Probes) -> Tensor:
    """Return `probes.probe` of images on its grid.  [..., P] -> [..., D]."""
    views = images.new_empty(*images.shape[:-1], probes.views)
    _call("asglight_probe", views.numel() // probes.views, probes, images.contiguous(), views)
    return views


def light(
    shown: "Images", places: Adaptive, frame: Target, probes: Probes
) -> tuple[Tensor, Tensor]:
    """Return `light._normal_equations`: [F, N, N] and [F, N, 3], in float64.

    Args:
        shown: The lobes on the adaptive cells.
        places: The adaptive cells.
        frame: The maps.
        probes: On the adaptive cells' grid.
    """
    frames, count = shown.scale.shape
    gram = shown.scale.new_empty(frames, count, count, dtype=torch.float64)
    slope = shown.scale.new_empty(frames, count, 3, dtype=torch.float64)
    given = _contiguous(shown.lobes.amplitude, shown.values, shown.scale)
    _call("asglight_light", frames, count, places, frame, probes, *given, gram, slope)
    return gram, slope


def minimise(
    start: "Images",
    found: "Images",
    damping: Tensor,
    steps: int,
    given: layout.Steps,
    report: Callable[[], None] | None,
) -> tuple[Tensor, Tensor]:
    """Take the steps of `newton.minimise`.

    Args:
        start: The lobes on their adaptive cells.
        found: Where the lobes are put after all steps, and before each call of `report`.
        damping: First damping.  [F]
        steps: Steps tried, taken or not.
        given: What they have in common.
        report: Called after each step.

    Returns:
        J with the temporal terms [F] and the damping of the next step [F].
    """
    frames, count = start.scale.shape
    value, damping = start.scale.new_empty(frames), damping.clone()
    raised: list[BaseException] = []

    def after_step() -> int:
        """Tell whether to stop."""
        assert report is not None
        try:
            report()
        except BaseException as error:  # C would drop it: it ends its steps instead
            raised.append(error)
        return len(raised)

    each = 0 if report is None else REPORT(after_step)
    lit = layout.lit(start), layout.lit(found)
    _call("asglight_minimise", frames, count, steps, given, *lit, damping, value, each)
    if raised:
        raise raised[0]
    return value, damping


def mixture(source: "Cells", taken: Tensor, steps: int) -> tuple[Tensor, Tensor, Tensor]:
    """Return what `seeding.expectation_maximisation` finds: axis_z, sharpness and taken.

    Args:
        source: The cells.
        taken: The share of each cell that each lobe takes at first.  [C, N]
        steps: How many.

    Returns:
        [N, 3], [N] and [C, N].
    """
    cells, lobes = taken.shape
    upper = source.second[:, *torch.triu_indices(3, 3)]
    unit = normalize(source.mean, dim=-1)
    rows = torch.cat([unit, source.weight[:, None], source.mean, upper], dim=-1)
    wide = -(-cells // WIDE) * WIDE
    own, shares = (pad(each.mT, (0, wide - cells)).contiguous() for each in (rows, taken))
    axis_z, sharpness = taken.new_empty(lobes, 3), taken.new_empty(lobes)
    least = taken.new_tensor(source.variance_min)
    _call("asglight_mixture", wide, lobes, steps, own, least, shares, axis_z, sharpness)
    return axis_z, sharpness, shares[:, :cells].mT


def _call(name: str, *arguments: Any) -> None:
    """Call a function with where tensors and structures begin, numbers and functions."""
    given = [
        each.data_ptr()
        if isinstance(each, Tensor)
        else addressof(each)
        if isinstance(each, Structure)
        else each
        for each in arguments
    ]
    assert LIBRARY is not None
    before = LIBRARY.asglight_begin(frame_threads())
    try:
        getattr(LIBRARY, name)(*given)
    finally:  # also where the call was interrupted
        LIBRARY.asglight_end(before)


def _contiguous(*tensors: Tensor) -> list[Tensor]:
    return [each.contiguous() for each in tensors]
