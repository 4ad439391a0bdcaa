# SPDX-License-Identifier: Apache-2.0
"""Levenberg-Marquardt steps on all lobes at once.

Each lobe moves in local coordinates, in which the problem has no singular point:

    tilt     axis_z turns by (t_x, t_y) towards axis_x, axis_y
    widths   s + 1/2 grows by a factor exp(e): like log s for narrow lobes, like s itself for broad
             ones, on which log s has no influence
    turn     a long lobe's frame turns about axis_z by an angle; a round one, which has no preferred
             axis, shears: D^1/2 exp([[0, e], [e, 0]]) D^1/2 with D = diag(sx + 1/2, sy + 1/2)
    light    the RGB amplitude, linear and never below 0

A step solves (H + damping diag H) delta = -gradient with the Gauss-Newton matrix H of J's quadratic
majoriser (objective.py) [Marquardt 1963]; a step that does not lower J is tried again with more
damping. 15 lobes are 120 unknowns: the cost is in the columns, not in the solve.

Columns are the images of each lobe and of its five derivatives: B [6 N, P].
"""

from dataclasses import dataclass

import numpy as np
import scipy.optimize
import torch
from torch import Tensor

from asglight.fitting import objective, temporal
from asglight.fitting.temporal import BROAD
from asglight.lobes import Form, Lobes, asg, texels
from asglight.lobes.frames import orthonormal

COLUMNS = 6
"""The lobe, two tilts, two widths, one turn."""

UNKNOWNS = 8
"""Five of the shape and three of the amplitude."""

DAMPING_START, DAMPING_MIN, DAMPING_MAX = 1e-2, 1e-6, 1e6
DAMPING_UP, DAMPING_DOWN = 5.0, 0.3

TILT_MAX_WIDTHS = 1.0
"""A step turns a lobe by at most its own width: beyond it the linear model says nothing."""

TILT_MAX = 0.5
"""Radians, for lobes broader than that."""

RELIGHT_PASSES = 3
"""Reweightings of the amplitudes' own problem: the third changes them by a percent or so."""

RIDGE = 1e-5
"""Of the unit diagonal of the amplitudes' Gram matrix: above the rounding of float32 sums."""

SHAPE_MAX = 1.0
"""A step changes a width's s + 1/2 by at most a factor e, and turns by at most a radian."""

ROUND_RATIO = 2.6
"""(sx + 1/2) / (sy + 1/2) up to which a lobe shears instead of turning: there both coordinates
move the lobe equally fast, |sx - sy| = sqrt((sx + 1/2) (sy + 1/2))."""


@dataclass(frozen=True)
class Outcome:
    """Lobes after some steps, with the state that continues them.

    Attributes:
        lobes: The lobes.  [N, .]
        value: J.
        damping: The damping of the next step.
    """

    lobes: Lobes
    value: float
    damping: float


def minimise(
    lobes: Lobes,
    frame: objective.Target,
    steps: int,
    *,
    prior: temporal.Prior | None = None,
    damping: float = DAMPING_START,
    width_min: float = 0.0,
    tolerance: float = 1e-4,
) -> Outcome:
    """Take at most `steps` accepted or hopeless steps.

    Args:
        lobes: Where to start.  [N, .]
        frame: The map and its weights.
        steps: Upper bound on Gauss-Newton matrices built.
        prior: The temporal term, added to J.
        damping: First damping.
        width_min: Sigma of the narrowest lobe allowed, radians.
        tolerance: Stop when a step lowers J by less than this share of it.
    """
    state: tuple[Tensor, float] | None = None
    for _ in range(steps):
        columns = lobe_columns(lobes, frame.directions, frame.height)
        if state is None:
            state = _judged(lobes, columns[::COLUMNS].mT @ lobes.amplitude, frame, prior)
        radiance, current = state
        hessian, gradient = normal_equations(columns, radiance, lobes, frame)
        if prior is not None:
            temporal.add_curvature(hessian, gradient, lobes, prior)
        while damping <= DAMPING_MAX:
            moved = advance(lobes, _solve(hessian, gradient, lobes, damping), width_min)
            reached = _judged(moved, texel_radiance(moved, frame), frame, prior)
            if reached[1] < current:
                lobes, state = moved, reached
                damping = max(damping * DAMPING_DOWN, DAMPING_MIN)
                break
            damping *= DAMPING_UP
        if current - state[1] <= tolerance * current:
            break
    if state is None:
        state = _judged(lobes, texel_radiance(lobes, frame), frame, prior)
    return Outcome(lobes, state[1], min(damping, DAMPING_MAX))


def _judged(
    lobes: Lobes, radiance: Tensor, frame: objective.Target, prior: temporal.Prior | None
) -> tuple[Tensor, float]:
    """Return the radiance and J, the temporal term included."""
    value = objective.value(radiance, frame)
    return radiance, value if prior is None else value + temporal.value(lobes, prior)


def relight(lobes: Lobes, frame: objective.Target, passes: int = RELIGHT_PASSES) -> Lobes:
    """Solve for the amplitudes alone, shapes held: the linear part of the problem.

    Each pass is a non-negative least squares problem of the reweighted normal equations for each
    channel [Lawson and Hanson 1974].
    """
    values = texels.unit_texel_means(lobes, frame.height, 2 * frame.height)  # [N, P]
    views = objective.probe(values, frame.height)
    amplitude = lobes.amplitude
    for _ in range(passes):
        gram, right = _light_equations(values, frame.radiance, amplitude, *_env(frame))
        for view, reference, scale, corner in zip(
            views, frame.probed, frame.probe_weight, frame.probe_corner, strict=True
        ):
            terms = _light_equations(view, reference, amplitude, scale, corner)
            gram, right = gram + terms[0], right + terms[1]
        amplitude = _non_negative(gram, right, amplitude.double()).to(amplitude)
    return Lobes(lobes.axes, lobes.sharpness, amplitude, lobes.form)


def _env(frame: objective.Target) -> tuple[Tensor, float]:
    return frame.env_weight, frame.env_corner


def _light_equations(
    values: Tensor, reference: Tensor, amplitude: Tensor, weight: Tensor | float, corner: float
) -> tuple[Tensor, Tensor]:
    """Return one term's reweighted Gram matrix [N, N] and right-hand side [N, 3]."""
    residual = values.mT @ amplitude - reference
    weighted = values * (weight / objective.phi(residual, corner))
    return (weighted @ values.mT).double(), (weighted @ reference).double()


def _non_negative(gram: Tensor, right: Tensor, near: Tensor) -> Tensor:
    """Minimise a^T G a / 2 - a^T b over a >= 0 for each channel, near to where a was.

    Lobes that coincide share a change evenly: the ridge, which pulls towards `near`, is as large
    as the rounding of a Gram matrix summed in float32, and grows where that is not enough.

    Args:
        gram: G.  [N, N]
        right: b.  [N, 3]
        near: The amplitudes so far.  [N, 3]
    """
    scale = torch.diagonal(gram).clamp(min=1e-300).rsqrt()  # to unit diagonal
    scaled = gram * scale[:, None] * scale[None, :]
    ridge, failed, factor = RIDGE, 1, scaled
    while failed:
        damped = scaled + ridge * torch.eye(len(scale)).to(scaled)
        factor, info = torch.linalg.cholesky_ex(damped)
        failed, ridge = int(info), 10 * ridge
    pulled = right * scale[:, None] + ridge / 10 * near / scale[:, None]
    target = torch.linalg.solve_triangular(factor, pulled, upper=False)
    matrix, columns = factor.mT.cpu().numpy(), target.cpu().numpy()
    solved = [scipy.optimize.nnls(matrix, columns[:, channel])[0] for channel in range(3)]
    return torch.from_numpy(np.stack(solved, axis=-1)).to(gram) * scale[:, None]


def texel_radiance(lobes: Lobes, frame: objective.Target) -> Tensor:
    """Return the lobes' radiance on the frame's grid, texel means.  [P, 3]."""
    values = texels.unit_texel_means(lobes, frame.height, 2 * frame.height)
    return values.mT @ lobes.amplitude


def lobe_columns(lobes: Lobes, directions: Tensor, height: int) -> Tensor:
    """Return B: each unit-amplitude lobe and its derivatives as texel means.

    Args:
        lobes: N lobes.  [N, .]
        directions: Texel centres.  [P, 3]
        height: Rows of the grid.

    Returns:
        Row 6 i is lobe i, rows 6 i + 1 to 6 i + 5 its derivatives.  [6 N, P]
    """
    columns = directions.new_zeros(lobes.count, COLUMNS, len(directions))
    narrow = texels.is_narrow(lobes, height)
    columns[~narrow] = local_columns(lobes.select(~narrow), directions)
    for index in torch.nonzero(narrow).flatten().tolist():
        lobe = lobes.select(torch.tensor([index], device=directions.device))
        reached = texels.texels_reached(lobe, directions, (height, 2 * height))
        columns[index][:, reached] = texels.mean_over_texels(
            lambda d, lobe=lobe: local_columns(lobe, d)[0], lobe, reached, (height, 2 * height)
        )
    return columns.flatten(0, 1)


def local_columns(lobes: Lobes, directions: Tensor) -> Tensor:
    """Return each lobe and its five derivatives at directions.  [N, 6, P]."""
    x, y, z = (lobes.axes @ directions.mT).unbind(1)  # [N, P]
    sx, sy = lobes.sharpness[..., None].unbind(1)  # [N, 1]
    if lobes.form is Form.SG:
        value = asg.unit_lobes(lobes, directions)
        none = torch.zeros_like(value)
        return torch.stack(
            [
                value,
                sx * x * value,
                sx * y * value,
                (sx + BROAD) * (z - 1) * value,
                none,
                none,
            ],
            dim=1,
        )
    gaussian = torch.exp(-sx * x * x - sy * y * y)
    if lobes.form is Form.ASG:
        gaussian = torch.where(z > 0, gaussian, 0.0)
        value = gaussian * z
        tilt_x = gaussian * x * (1 + 2 * sx * z * z)
        tilt_y = gaussian * y * (1 + 2 * sy * z * z)
    else:
        value = gaussian
        tilt_x = gaussian * x * (2 * sx * z)
        tilt_y = gaussian * y * (2 * sy * z)
    widths = [-(sx + BROAD) * x * x * value, -(sy + BROAD) * y * y * value]
    speed = torch.where(is_round(lobes)[:, None], ((sx + BROAD) * (sy + BROAD)).sqrt(), sx - sy)
    return torch.stack([value, tilt_x, tilt_y, *widths, -2 * speed * x * y * value], dim=1)


def is_round(lobes: Lobes) -> Tensor:
    """Tell which lobes shear instead of turning.  [N]."""
    shifted = lobes.sharpness + BROAD
    return shifted.amax(-1) < ROUND_RATIO * shifted.amin(-1)


def normal_equations(
    columns: Tensor, radiance: Tensor, lobes: Lobes, frame: objective.Target
) -> tuple[Tensor, Tensor]:
    """Return the Gauss-Newton matrix and the gradient of J.

    Args:
        columns: B.  [6 N, P]
        radiance: The lobes' radiance.  [P, 3]
        lobes: The lobes.
        frame: The map and its weights.

    Returns:
        H [8 N, 8 N] and g [8 N] in float64, unknowns of a lobe together, shape before light.
    """
    residual = radiance - frame.radiance
    weight = frame.env_weight / objective.phi(residual, frame.env_corner)
    weighted = columns * weight
    gram = (weighted @ columns.mT).double()
    slope = (weighted @ residual).double()  # [6 N, 3]
    views = objective.probe(columns, frame.height)
    for view, reference, scale, corner in zip(
        views, frame.probed, frame.probe_weight, frame.probe_corner, strict=True
    ):
        residual = view[::COLUMNS].mT @ lobes.amplitude - reference
        weighted = view * (scale / objective.phi(residual, corner))
        gram += (weighted @ view.mT).double()
        slope += (weighted @ residual).double()
    return _chain(gram, slope, lobes.amplitude.double())


def _chain(gram: Tensor, slope: Tensor, amplitude: Tensor) -> tuple[Tensor, Tensor]:
    """Go from columns to unknowns: a shape unknown moves each channel by the lobe's amplitude."""
    count = amplitude.shape[0]
    blocks = gram.reshape(count, COLUMNS, count, COLUMNS)
    slopes = slope.reshape(count, COLUMNS, 3)
    shape_shape = torch.einsum("ikjl,ij->ikjl", blocks[:, 1:, :, 1:], amplitude @ amplitude.mT)
    shape_light = torch.einsum("ikj,ic->ikjc", blocks[:, 1:, :, 0], amplitude)
    light_light = torch.einsum("ij,cd->icjd", blocks[:, 0, :, 0], torch.eye(3).to(gram))
    hessian = gram.new_zeros(count, UNKNOWNS, count, UNKNOWNS)
    hessian[:, :5, :, :5] = shape_shape
    hessian[:, :5, :, 5:] = shape_light
    hessian[:, 5:, :, :5] = shape_light.permute(2, 3, 0, 1)
    hessian[:, 5:, :, 5:] = light_light
    gradient = torch.cat(
        [torch.einsum("ikc,ic->ik", slopes[:, 1:], amplitude), slopes[:, 0]], dim=-1
    )
    size = count * UNKNOWNS
    return hessian.reshape(size, size), gradient.reshape(size)


def _solve(hessian: Tensor, gradient: Tensor, lobes: Lobes, damping: float) -> Tensor:
    """Solve the damped system; unknowns at a bound that would cross it stay.  [N, 8]."""
    step_gradient = gradient.reshape(lobes.count, UNKNOWNS)
    held = torch.zeros_like(step_gradient, dtype=torch.bool)
    held[:, 2:4] = (lobes.sharpness <= asg.SHARPNESS_MIN) & (step_gradient[:, 2:4] > 0)
    held[:, 5:] = (lobes.amplitude <= 0) & (step_gradient[:, 5:] > 0)
    free = ~held.reshape(-1)
    diagonal = torch.diagonal(hessian)
    # unknowns that nothing in the map sees get unit curvature, far above their gradient of 0
    curvature = torch.where(
        diagonal > 1e-12 * diagonal.max(), diagonal, diagonal.max().clamp(min=1e-300)
    )
    matrix = torch.where(free[:, None] & free[None, :], hessian, 0.0)
    matrix = matrix + torch.diag(torch.where(free, damping * curvature, 1.0))
    # scaled to unit diagonal: sharpness and radiance differ by ten orders of magnitude
    scale = torch.diagonal(matrix).clamp(min=1e-300).rsqrt()
    scaled = matrix * scale[:, None] * scale[None, :]
    right = torch.where(free, -gradient, 0.0) * scale
    factor, failed = torch.linalg.cholesky_ex(scaled)
    if int(failed):
        return torch.zeros_like(step_gradient)
    return (torch.cholesky_solve(right[:, None], factor)[:, 0] * scale).reshape(-1, UNKNOWNS)


def advance(lobes: Lobes, step: Tensor, width_min: float = 0.0) -> Lobes:
    """Move lobes by a step in local coordinates, within its trust bounds.  step: [N, 8]."""
    step = step.to(lobes.axes.dtype)
    tilt, shape, light = step[:, :2], step[:, 2:5], step[:, 5:]
    widths = (1.0 if lobes.form is Form.SG else 2.0) * lobes.sharpness
    bound = (TILT_MAX_WIDTHS * widths.clamp(min=1e-6).rsqrt()).clamp(max=TILT_MAX)
    tilt = torch.maximum(torch.minimum(tilt, bound), -bound)
    shape = shape * (SHAPE_MAX / shape.abs().amax(-1, keepdim=True).clamp(min=SHAPE_MAX))
    axis_z = lobes.axis_z + tilt[:, :1] * lobes.axis_x + tilt[:, 1:] * lobes.axis_y
    sharpness, axis_x = _reshape(lobes, shape)
    axes = orthonormal(torch.stack([axis_x, lobes.axis_y, axis_z], dim=-2))
    limit = asg.SHARPNESS_MAX
    if width_min > 0:
        limit = min(limit, 1 / ((1.0 if lobes.form is Form.SG else 2.0) * width_min**2))
    sharpness = sharpness.clamp(min=asg.SHARPNESS_MIN, max=limit)
    return Lobes(axes, sharpness, (lobes.amplitude + light).clamp(min=0), lobes.form)


def _reshape(lobes: Lobes, shape: Tensor) -> tuple[Tensor, Tensor]:
    """Apply width changes and the turn; return the new sharpnesses and axis_x."""
    if lobes.form is Form.SG:
        return (lobes.sharpness + BROAD) * shape[:, :1].exp() - BROAD, lobes.axis_x
    turn = shape[:, 2:]
    turned = turn.cos() * lobes.axis_x + turn.sin() * lobes.axis_y
    factors = shape[:, :2].exp()
    sheared_sharpness, sheared = _shear(lobes, shape)
    round_ = is_round(lobes)[:, None]
    sharpness = (lobes.sharpness + BROAD) * factors
    return torch.where(round_, sheared_sharpness, sharpness) - BROAD, torch.where(
        round_, sheared, turned
    )


def _shear(lobes: Lobes, shape: Tensor) -> tuple[Tensor, Tensor]:
    """Apply widths and shear to s + 1/2 as a matrix; return its eigenvalues and axis_x."""
    root = (lobes.sharpness + BROAD).sqrt()
    change = torch.stack(
        [torch.stack([shape[:, 0], shape[:, 2]], -1), torch.stack([shape[:, 2], shape[:, 1]], -1)],
        dim=-2,
    )
    matrix = root[:, :, None] * torch.linalg.matrix_exp(change) * root[:, None, :]
    values, vectors = torch.linalg.eigh(matrix.double())  # ascending
    swap = vectors[:, 0, 0].abs() > vectors[:, 0, 1].abs()  # keep x where x was
    first = torch.where(swap[:, None], vectors[:, :, 0], vectors[:, :, 1])
    first = first * torch.where(first[:, :1] < 0, -1.0, 1.0)
    values = torch.where(swap[:, None], values, values.flip(-1)).to(root.dtype)
    first = first.to(root.dtype)
    return values, first[:, :1] * lobes.axis_x + first[:, 1:] * lobes.axis_y
