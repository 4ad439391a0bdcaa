# SPDX-License-Identifier: Apache-2.0
"""What is checked of a stress case, one function a check: numbers in, an error out.

Every reference is computed in float64. An error that is not a number counts as infinite: NaN would
pass every bound.
"""

import functools
import math
import tempfile
from pathlib import Path
from typing import Protocol

import torch
from scipy.optimize import linear_sum_assignment
from torch import Tensor

from asglight.judging import metrics
from asglight.judging.stress.case import Recovery
from asglight.lobes import Form, Lobes, LobeTracks, asg, texels
from asglight.lobes.frames import align, canonical
from asglight.shading import ggx, ggx_layer, ggx_lobes, rectified
from asglight.shading.balls import pixel_centres
from asglight.shading.sheets import amplitudes, sheets
from asglight.sphere import latlong
from asglight.sphere.quadrature import fibonacci_directions
from asglight.usd import write_usd
from asglight.usd.read.tracks import read_stage

NORMAL_MIN = 1.1754944e-38
"""The least normal number of float32. Smaller ones have few digits, and OpenGL may take them as 0:
a difference of no more than this is none."""

AROUND = 3
"""Deviations around a lobe's centre within which directions are drawn."""

NEAR, EVEN = 48, 256
"""Directions drawn around each lobe and evenly."""

BALL_PIXELS = 24
ROUGHNESS = 0.5
"""Of the glossy ball: there the shaders' albedo table is within 5e-4."""

VIEW = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)


class Shader(Protocol):
    """The shaders' evaluation of lobes (asglight.viewer.gl.lobe_probe)."""

    name: str
    lobes_max: int

    def radiance(self, lobes: Lobes, directions: Tensor) -> Tensor:
        """Return radiance at unit directions.  [P, 3]."""
        ...

    def ball(self, lobes: Lobes, roughness: float | None, size: int) -> Tensor:
        """Return the pixels of a white ball, of metal or Lambertian.  [size, size, 3]."""
        ...


def largest(errors: Tensor) -> float:
    """Return the largest of some errors; infinity where any is not a number."""
    if not errors.numel():
        return 0.0
    return float(torch.where(errors.isnan(), math.inf, errors.double().abs()).max())


def not_finite(lobes: Lobes) -> int:
    """Count the numbers of lobes, and of their flux, that are not finite or out of range."""
    numbers = (lobes.axes, lobes.sharpness, lobes.amplitude, asg.flux(lobes))
    wrong = sum(int((~values.isfinite()).sum()) for values in numbers)
    return wrong + int((lobes.sharpness <= 0).sum()) + int((lobes.amplitude < 0).sum())


def flux_error(lobes: Lobes, radiance: Tensor) -> float:
    """Return |flux of the lobes over that of the map - 1|, by the exact integral of the lobes.

    Args:
        lobes: N lobes.  [N, .]
        radiance: Repaired map.  [H, W, 3]

    Returns:
        The relative error; of a black map 0 for black lobes, else infinity.
    """
    found = float(asg.flux(lobes.to(torch.float64)).sum())
    solid_angle = latlong.texel_solid_angles(*radiance.shape[:2], dtype=torch.float64)
    wanted = float((solid_angle[..., None] * radiance.double()).sum())
    if wanted == 0:
        return 0.0 if found == 0 else math.inf
    return abs(found / wanted - 1) if math.isfinite(found) else math.inf


def irradiance_error(lobes: Lobes, radiance: Tensor) -> float:
    """Return irr of a frame (metrics.py).

    Args:
        lobes: N lobes.  [N, .]
        radiance: Repaired map.  [H, W, 3]
    """
    error = metrics.irradiance_error(lobes, radiance)
    return error if math.isfinite(error) else math.inf


def stage_error(tracks: LobeTracks) -> float:
    """Write a stage, read it back, and return the largest change of any lobe.

    Returns:
        The largest of the angle between frames in radians, the change of a sharpness relative to
        it, and that of an amplitude relative to the lobe's brightest channel. Infinity where frames
        or names differ or a light reads as edited by another program.
    """
    with tempfile.TemporaryDirectory(prefix="asglight-") as folder:
        path = Path(folder) / "stress.usdc"
        # the dome's images are no part of what is read back: 16 rows save most of the time
        write_usd(tracks, path, dome_height=16)
        reading = read_stage(path)
    found = reading.tracks
    same = found.frames == tracks.frames and found.names == tracks.names
    if not same or reading.changes:
        return math.inf
    return lobes_change(tracks.lobes, found.lobes)


def lobes_change(before: Lobes, after: Lobes) -> float:
    """Return the largest change of any lobe, as `stage_error` counts it.  [..., N, .].

    A lobe is the same with its axes x and y and their sharpness exchanged: a stage has those that
    turn least from frame to frame.
    """
    a, b = before.to(torch.float64), after.to(torch.float64)
    if a.axes.shape != b.axes.shape or a.form is not b.form:
        return math.inf
    b = align(b, a)
    angle = (a.axes - b.axes).norm(dim=-1)
    sharpness = (b.sharpness - a.sharpness) / a.sharpness
    brightest = a.amplitude.amax(-1, keepdim=True).clamp(min=NORMAL_MIN)
    amplitude = (b.amplitude - a.amplitude) / brightest  # denormals are kept as they are
    return max(largest(angle), largest(sharpness), largest(amplitude))


def shader_error(shader: Shader, lobes: Lobes) -> float:
    """Return the largest difference of the shaders' radiance from the library's in float64.

    Args:
        shader: The shaders.
        lobes: At most `lobes_max`, rounded to float32 first, as the shaders see them.  [N, .]

    Returns:
        Relative to the brightest radiance there is.
    """
    seen = lobes.to(torch.float32)
    directions = directions_around(seen)
    expected = asg.evaluate(seen.to(torch.float64), directions.double())
    return _relative_to_brightest(shader.radiance(seen, directions), expected)


def directions_around(lobes: Lobes) -> Tensor:
    """Draw directions evenly and around each lobe, as wide as it is.  [P, 3] float32."""
    generator = torch.Generator().manual_seed(0)
    offset = torch.randn(lobes.count, NEAR, 2, generator=generator, dtype=torch.float64)
    widths = (2 * lobes.sharpness.double()).clamp(min=1).rsqrt()[:, None]
    x, y = (offset.clamp(-AROUND, AROUND) * widths).unbind(-1)
    axes = lobes.axes.double()
    near = x[..., None] * axes[:, None, 0] + y[..., None] * axes[:, None, 1] + axes[:, None, 2]
    near = torch.cat([near.flatten(0, 1), axes[:, 2], -axes[:, 2]])
    near = torch.nn.functional.normalize(near, dim=-1)
    return torch.cat([near, fibonacci_directions(EVEN, dtype=torch.float64)]).float()


def balls_error(shader: Shader, lobes: Lobes) -> float:
    """Return the largest difference of a matte and a glossy ball's pixels from the library's.

    Args:
        shader: The shaders.
        lobes: At most `lobes_max`.  [N, .]

    Returns:
        Relative to each ball's brightest pixel.
    """
    seen = lobes.to(torch.float32).to(torch.float64)
    normals, inside = ball_normals(BALL_PIXELS)
    light = amplitudes(seen)
    matte = torch.einsum("mp,mc->pc", rectified.irradiance_over_pi(sheets(seen), normals), light)
    white = torch.ones(3, dtype=torch.float64)
    layer = ggx_layer.layer(torch.tensor(ROUGHNESS, dtype=torch.float64))
    shown = ggx_lobes.reflected(sheets(seen), normals, VIEW, layer, white, _albedo())
    glossy = torch.einsum("mpc,mc->pc", shown, light)
    errors = [
        _relative_to_brightest(shader.ball(seen, roughness, BALL_PIXELS)[inside], expected)
        for roughness, expected in ((None, matte), (ROUGHNESS, glossy))
    ]
    return max(errors)


@functools.cache
def _albedo() -> Tensor:
    """Return the glossy ball's albedo in parts, where it is checked.  [P, 2]."""
    normals, _ = ball_normals(BALL_PIXELS)
    return ggx.albedo_parts(normals[:, 2], ROUGHNESS**2)


def ball_normals(size: int) -> tuple[Tensor, Tensor]:
    """Return normals of the pixels that lie within a ball seen from +Z, and which those are.

    Returns:
        Unit normals in float64 [P, 3]; a mask [size, size] with P pixels.
    """
    x, y = pixel_centres(size, torch.float64).unbind(-1)
    square = x * x + y * y
    inside = square.sqrt() < 1 - 2 / size  # the whole pixel, with its corners
    z = (1 - square[inside]).sqrt()
    return torch.stack([x[inside], y[inside], z], dim=-1), inside


def _relative_to_brightest(found: Tensor, expected: Tensor) -> float:
    """Return the largest difference beyond `NORMAL_MIN` over the brightest value expected."""
    apart = ((found.double() - expected).abs() - NORMAL_MIN).clamp(min=0)
    return largest(apart / max(float(expected.max()), NORMAL_MIN))


def recovery_errors(found: Lobes, known: Lobes) -> Recovery:
    """Match fitted lobes with the known ones by direction and return the largest differences.

    Args:
        found: As many lobes as are known, or more.  [M, .]
        known: The lobes that the map was rendered from.  [N, .]

    Returns:
        Errors as `Recovery` bounds them; infinite where lobes are missing.
    """
    if found.count < known.count:
        return Recovery(math.inf, math.inf, math.inf)
    known, found = (canonical(lobes.to(torch.float64)) for lobes in (known, found))
    cosine = known.axis_z @ found.axis_z.mT  # [N, M]
    if known.form is Form.BINGHAM:  # the same at d and -d
        cosine = cosine.abs()
    angles = torch.acos(cosine.clamp(-1, 1))
    _, order = linear_sum_assignment(angles.numpy())
    found = found.select(torch.from_numpy(order))
    apart = torch.stack([(found.axis_z - s * known.axis_z).norm(dim=-1) for s in (1, -1)])
    chord = apart.amin(0) if known.form is Form.BINGHAM else apart[0]
    brightest = known.amplitude.amax(-1, keepdim=True)
    return Recovery(
        largest(chord / texels.lobe_width(known).clamp(max=1)),
        largest(found.sharpness / known.sharpness - 1),
        largest((found.amplitude - known.amplitude) / brightest),
    )
