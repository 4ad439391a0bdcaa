# SPDX-License-Identifier: Apache-2.0
"""Pictures that show a lighting artist what a fit keeps and what it loses.

`contact_sheet` compares maps over time with the lobes drawn on them, `ball_sheet` compares balls.
Everything on a sheet is seen at one exposure, chosen from the references (`judging.display`).

Symbols: K frames on the sheet, N lobes, R roughnesses, S pixels across a ball.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from torch import Tensor

from asglight.errors import InputError
from asglight.judging.pictures.display import (
    ball_exposure_stops,
    exposure_stops,
    luminance,
    view_transform,
)
from asglight.judging.pictures.layout import FAINT, TEXT, Grid, save, sheet
from asglight.judging.pictures.outlines import draw_lobes
from asglight.lobes import Lobes
from asglight.shading.balls import coverage
from asglight.sphere import latlong

FRAMES_MAX = 6
"""Rows of a contact sheet: what fits a screen with maps large enough to read."""

BALL_FRAMES_MAX = 4
_DIFFERENCE_RANGE = 2.0
"""Of the mean luminance: most of a map lies inside, and what is outside is plainly wrong."""

DIFFERENCE_COLOURS = LinearSegmentedColormap.from_list(
    "too_dark_too_bright", ["#a8dcff", "#2b83d6", "#2c2d30", "#d9781c", "#ffdca8"]
)
"""Blue and orange, which every kind of colour vision tells apart; dark where nothing differs."""


def contact_sheet(
    path: Path,
    frames: Sequence[int],
    references: Tensor,
    fits: Tensor,
    lobes: Lobes,
    title: str,
    *,
    errors: Mapping[str, Sequence[float]] | None = None,
) -> None:
    """Draw reference, fit with its lobes, and difference, one row per frame.

    The difference is that of luminance, divided by the mean luminance of the frame's reference.

    Args:
        path: PNG file to write.
        frames: K frame numbers; at most six of them, evenly chosen, are shown.
        references: Maps.  [K, H, W, 3]
        fits: What the lobes make of them.  [K, H, W, 3]
        lobes: The lobes.  [K, N, .]
        title: Heading.
        errors: Numbers to print under each row, by name: K relative errors each, such as env, irr.

    Raises:
        InputError: The arguments do not belong together, or the file cannot be written.
    """
    _check_sheet(frames, references, fits)
    if lobes.axes.ndim != 4 or len(lobes.axes) != len(frames):
        raise InputError(
            f"lobes: shape {tuple(lobes.axes.shape[:-2])}; expected [{len(frames)}, N]."
        )
    shown = _spread(len(frames), FRAMES_MAX)
    stops = exposure_stops(references)
    row_height, top = 322, 116
    note = f"exposure {stops:+.1f} stops, sRGB, the same everywhere"
    figure = sheet(1800, top + row_height * len(shown) + 64, title, note)
    grid = Grid(figure, left=88, top=top, cell=(556, 278), step=(568, row_height))
    image: AxesImage | None = None
    for row, index in enumerate(shown):
        reference, fit = references[index].cpu(), fits[index].cpu()
        for column, radiance in enumerate((reference, fit)):
            axes = grid.axes(row, column)
            show(axes, view_transform(radiance, stops))
            if column == 1:
                draw_lobes(axes, lobes[index].to("cpu"))
        image = _show_difference(grid.axes(row, 2), reference, fit)
        grid.row_label(row, f"{frames[index]}")
        grid.caption(row, 1, _caption(errors, index))
    for column, name in enumerate(("reference", "fit and its lobes", "fit - reference")):
        grid.column_title(column, name)
    assert image is not None
    _colour_bar(figure, image, grid, len(shown))
    save(figure, path)


def ball_sheet(
    path: Path,
    frames: Sequence[int],
    roughness: Sequence[float],
    reference_balls: Tensor,
    fit_balls: Tensor,
    title: str,
) -> None:
    """Draw balls lit by the reference and by the lobes, one above the other, with their error.

    The number under a ball is the sum of absolute differences over the sum of the reference, over
    all its pixels and channels. The exposure is that of the roughest balls' median.

    Args:
        path: PNG file to write.
        frames: K frame numbers; at most four of them, evenly chosen, are shown.
        roughness: R roughnesses.
        reference_balls: Rendered under the maps.  [K, R, S, S, 3]
        fit_balls: Rendered under the lobes.  [K, R, S, S, 3]
        title: Heading.

    Raises:
        InputError: The arguments do not belong together, or the file cannot be written.
    """
    _check_sheet(frames, reference_balls, fit_balls)
    if reference_balls.ndim != 5 or reference_balls.shape[1] != len(roughness):
        raise InputError(
            f"balls: shape {tuple(reference_balls.shape)}; expected "
            f"[{len(frames)}, {len(roughness)}, S, S, 3]."
        )
    shown = _spread(len(frames), BALL_FRAMES_MAX)
    stops = ball_exposure_stops(reference_balls)
    size, step, top, block = 192, 212, 128, 464
    note = f"exposure {stops:+.1f} stops, sRGB"
    figure = sheet(max(148 + step * len(roughness), 900), top + block * len(shown), title, note)
    for row, index in enumerate(np.repeat(shown, 2).tolist()):
        offset = top + (row // 2) * block + (row % 2) * (size + 12)
        grid = Grid(figure, left=140, top=offset, cell=(size, size), step=(step, size))
        balls = (reference_balls, fit_balls)[row % 2][index].cpu()
        for column in range(len(roughness)):
            show(grid.axes(0, column), cut_out(balls[column], stops))
            if row % 2:
                error = _relative_error(fit_balls[index, column], reference_balls[index, column])
                grid.caption(0, column, f"{100 * error:.1f} %", centred=True)
            if row == 0:
                grid.column_title(column, f"roughness {roughness[column]:g}")
        grid.row_label(0, "lobes" if row % 2 else f"{frames[index]}\nreference")
    save(figure, path)


def _check_sheet(frames: Sequence[int], references: Tensor, fits: Tensor) -> None:
    if not frames or references.shape != fits.shape or len(references) != len(frames):
        raise InputError(
            f"fits: shape {tuple(fits.shape)} beside references {tuple(references.shape)} for "
            f"{len(frames)} frames; expected one of each for every frame, of one shape."
        )


def _spread(count: int, most: int) -> list[int]:
    """Choose at most so many of `count` indices, evenly, with the first and the last."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(int)).tolist()


def show(axes: Axes, picture: np.ndarray) -> None:
    """Show a picture so that data coordinates are u, v in [0, 1] from the top left corner."""
    axes.imshow(picture, extent=(0, 1, 1, 0), aspect="auto", interpolation="lanczos")


def _show_difference(axes: Axes, reference: Tensor, fit: Tensor) -> AxesImage:
    height, width = reference.shape[:2]
    solid_angles = latlong.texel_solid_angles(height, width)
    mean = float((luminance(reference) * solid_angles).sum() / solid_angles.sum())
    scale = mean if mean > 0 else 1.0  # a black frame: the difference itself
    difference = (luminance(fit) - luminance(reference)) / scale
    return axes.imshow(
        difference.numpy(),
        extent=(0, 1, 1, 0),
        aspect="auto",
        cmap=DIFFERENCE_COLOURS,
        vmin=-_DIFFERENCE_RANGE,
        vmax=_DIFFERENCE_RANGE,
    )


def _colour_bar(figure: Figure, image: AxesImage, grid: Grid, rows: int) -> None:
    """Draw the scale of the differences under the last row of the third column."""
    x, y = grid.corner(rows, 2)
    width, height = grid.cell[0], 12
    box = (x / grid.width, 1 - (y + height) / grid.height, width / grid.width, height / grid.height)
    bar = figure.colorbar(image, cax=figure.add_axes(box), orientation="horizontal", extend="both")
    bar.outline.set_visible(False)
    bar.set_ticks([-2, -1, 0, 1, 2], labels=["-2", "too dark  -1", "0", "+1  too bright", "+2"])
    bar.ax.tick_params(color=FAINT, labelcolor=TEXT, labelsize=11, length=0, pad=5)
    grid.write(x - 12, y + 4, "luminance difference / mean of the reference", 11, FAINT, "right")


def _caption(errors: Mapping[str, Sequence[float]] | None, index: int) -> str:
    return "    ".join(
        f"{name} {100 * values[index]:.1f} %" for name, values in (errors or {}).items()
    )


def cut_out(ball: Tensor, stops: float) -> np.ndarray:
    """Return a ball as sRGB with its coverage as alpha.  [S, S, 3] -> [S, S, 4]."""
    alpha = coverage(ball.shape[0])
    colour = view_transform(ball / alpha.clamp(min=1e-3)[..., None], stops)
    opacity = (alpha * 255).round().to(torch.uint8).numpy()
    return np.concatenate([colour, opacity[..., None]], axis=-1)


def _relative_error(fit: Tensor, reference: Tensor) -> float:
    total = float(reference.abs().sum())
    return float((fit - reference).abs().sum()) / total if total > 0 else 0.0
