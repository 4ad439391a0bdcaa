# SPDX-License-Identifier: Apache-2.0
"""Fit the constants of asglight.shading.ggx_lobes to random scenes and write them.

A scene is some random lobes of one form, seen from a random side under a random roughness, and
integrated by brute force at points of a ball. Its lights are mixed anew at every step: it is whole
environments that the constants serve, and of them the worst. No map is used.
Adam moves the constants so that the error of a ball's light, in units of what
docs/method/shading.md allows at its roughness, is small on average and at the fourth power. Prints
the errors of scenes that were not fitted. Two and a half minutes of a core. `--measure` prints
those of the constants that are there, and leaves them.

    python -m benchmarks.shaded.constants
    python -m benchmarks.shaded.constants --measure
"""

import argparse
import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from asglight.cli.folders import write_text
from asglight.lobes import Form, Lobes, asg, frames
from asglight.shading import brute_force, ggx, ggx_layer, ggx_lobes, ggx_lobes_constants
from asglight.shading.sheets import Sheets, Window, sheets

OUTPUT = Path(ggx_lobes.__file__).with_name("ggx_lobes_constants.py")
VIEW = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)
LOBES = 8
"""Of a scene; with flux as uneven as FLUX_SPREAD two or three of them decide."""
POINTS = 60
"""Of a ball. The noise of 60 is that of one scene; there are many."""
RATIO_EXPONENT = 3.6
"""Of the largest ratio, 4000, as fits have it of long lamps and horizons; half are below 8."""
BEHIND = 0.25
"""Share of the lobes that are drawn behind the ball, where both approximations are worst."""
SAMPLES = 256
"""Of the brute force; 0.2 % of a ball's light."""
FLUX_SPREAD = 1.5
"""Deviation of log(flux) of the lobes of a mix."""
MIXES = 4
"""Of each scene in each step."""
DARK = 0.02
"""Share of a scene's light that is added to that of its ball, a quarter of it where the ball is
smooth: a scene that lies behind a rough ball is no reason to bend the constants."""
ROUGHNESS_LIMITS = ((0.05, 0.03), (0.1, 0.03), (0.25, 0.035), (0.5, 0.05), (1.0, 0.03))
"""Errors to aim at, linear in between over log(roughness)."""
OUTLIER = 5.0
"""Largest error that counts, in units of what is wanted: a few scenes have no good answer."""
DEGREES = 5
"""Chebyshev polynomials of log(roughness)."""
STEPS = 700
LEARNING_RATE = 0.05
BATCH = 20
"""Scenes of each form in a step: its tensors stay within a processor's cache."""

REPORTED = (0.07, 0.14, 0.35, 0.6, 1.0)
"""Upper ends of the intervals of roughness for which errors are printed."""

Constants = dict[str, Tensor]


class Scenes(NamedTuple):
    """B scenes of N lobes of one form, each with its own ball.

    Attributes:
        roughness: [B]
        sheets: With a dimension of points.  [B, M, 1, .]
        flux: Of the lobes.  [B, N]
        normals: [B, 1, P, 3]
        area: Of the ball's image that a point stands for.  [B, P]
        albedo: [B, 1, P]
        truth: What each lobe of amplitude 1 shows at Fresnel reflectance 1.  [B, N, P]
    """

    roughness: Tensor
    sheets: Sheets
    flux: Tensor
    normals: Tensor
    area: Tensor
    albedo: Tensor
    truth: Tensor

    def some(self, index: Tensor) -> "Scenes":
        """Pick scenes."""
        *numbers, window = self.sheets
        axes, disc_variance, integral, mean, variance = (values[index] for values in numbers)
        made = Sheets(axes, disc_variance, integral, mean, variance, window)
        roughness, _, *others = self
        return Scenes(roughness[index], made, *(values[index] for values in others))


FORMS = (Form.ASG, Form.BINGHAM, Form.SG)
"""Those with a window of their own; flat lobes are sums of asg ones."""


def main(argv: Sequence[str] | None = None) -> None:
    """Draw, fit, check, write; or check what is there."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=480, help="random scenes of each form (480)")
    parser.add_argument("--steps", type=int, default=STEPS, help=f"steps of the fit ({STEPS})")
    parser.add_argument("--terms", type=int, default=3, help="Gaussians of the kernel (3)")
    parser.add_argument("-o", "--output", type=Path, default=OUTPUT, help="the constants' module")
    parser.add_argument(
        "--measure", action="store_true", help="fit nothing: measure the constants that are there"
    )
    options = parser.parse_args(argv)
    torch.manual_seed(0)
    torch.set_num_threads(1)  # sums in the same order everywhere
    held_out = {form: draw(form, options.scenes // 4) for form in FORMS}
    if options.measure:
        report(shipped(), held_out)
        return
    scenes = {form: draw(form, options.scenes) for form in FORMS}
    constants = fitted(scenes, options.terms, options.steps)
    report(constants, held_out)
    write_text(options.output, module(constants))


def draw(form: Form, count: int) -> Scenes:
    """Draw scenes of one form and integrate them."""
    # Both ends of the interval get their part of the scenes.
    place = (torch.arange(count, dtype=torch.float64) + torch.rand(count)) / count
    roughness = 0.05 * 20 ** (1.1 * place - 0.05).clamp(0, 1)
    lobes = random_lobes(form, roughness)
    normals, area, albedo, truth = [], [], [], []
    for scene, rough in zip(range(count), roughness.tolist(), strict=True):
        lit = Lobes(lobes.axes[scene], lobes.sharpness[scene], lobes.amplitude[scene], form)
        n, a = brute_force.ball_points(lit, rough, POINTS)
        normals.append(n)
        area.append(a)
        albedo.append(ggx.albedo(n[:, 2], rough**2))
        truth.append(brute_force.reflected(lit, n, VIEW, rough, SAMPLES).sum(-1))
    return Scenes(
        roughness,
        sheets(lobes).over_points(),
        asg.integral(lobes),
        torch.stack(normals)[:, None],
        torch.stack(area),
        torch.stack(albedo)[:, None],
        torch.stack(truth),
    )


def random_lobes(form: Form, roughness: Tensor) -> Lobes:
    """Draw lobes of flux 1: half of them of any width, half about as wide as the reflection.

    Args:
        form: Of the lobes.
        roughness: [B]

    Returns:
        [B, N, .]
    """
    shape = len(roughness), LOBES
    anywhere = -1 + 6.3 * torch.rand(shape, dtype=torch.float64)
    alike = torch.randn(shape, dtype=torch.float64) - 4 * torch.log10(roughness)[:, None]
    exponent = torch.where(torch.rand(shape) < 0.5, anywhere, alike).clamp(-1, 5.3)
    ratio = 10 ** (RATIO_EXPONENT * torch.rand(shape, dtype=torch.float64).square())
    round_ones = torch.rand(shape) < (1.0 if form is Form.SG else 0.25)
    root = torch.where(round_ones, 1.0, ratio).sqrt()
    s = 10**exponent
    towards = torch.nn.functional.normalize(torch.randn(*shape, 3, dtype=torch.float64), dim=-1)
    behind = torch.rand(shape) < BEHIND
    towards = torch.where(behind[..., None], towards - VIEW, towards)
    axes = rolled(frames.axes_around(torch.nn.functional.normalize(towards, dim=-1)))
    amplitude = torch.ones(*shape, 3, dtype=torch.float64)
    lobes = Lobes(axes, torch.stack([s * root, s / root], dim=-1), amplitude, form)
    return Lobes(axes, lobes.sharpness, amplitude / asg.integral(lobes)[..., None], form)


def rolled(axes: Tensor) -> Tensor:
    """Turn axes about their axis_z by random angles.  [..., 3, 3]."""
    turn = 2 * math.pi * torch.rand(axes.shape[:-2], dtype=torch.float64)
    cos, sin = turn.cos()[..., None], turn.sin()[..., None]
    axis_x, axis_y, axis_z = axes.unbind(-2)
    return torch.stack([cos * axis_x + sin * axis_y, cos * axis_y - sin * axis_x, axis_z], dim=-2)


def shown(constants: Constants, scenes: Scenes) -> Tensor:
    """Return what the closed form shows of each lobe of amplitude 1.  [B, N, P]."""
    layer = ggx_layer.layer_from(scenes.roughness[:, None], constants["kernel"], constants["share"])
    over_points = ggx_layer.Layer(layer.alpha[:, None], layer.kernel[:, None], layer.share[:, None])
    at_sheets = over_points._replace(kernel=layer.kernel, share=layer.share[:, None])
    made, seen = scenes.sheets, ggx_lobes.surface(scenes.normals, VIEW)
    places = {Window.COSINE: 0, Window.STEP: 1}
    disc = constants["log_disc"][places[made.window]].exp() if made.window in places else 0.25
    part = ggx_layer.share(made, VIEW, at_sheets)
    blurred = ggx_lobes.broad(made, ggx_lobes.kernel(seen, over_points), disc)
    tilted = ggx_layer.tilt(made, VIEW, over_points)
    mirrored = ggx_lobes.narrow(made, tilted, seen, over_points)
    left = (1 - part) * ggx_layer.kept(made, VIEW, at_sheets)
    both = part * mirrored + left * scenes.albedo * blurred
    return both.unflatten(1, (-1, scenes.flux.shape[1])).sum(1)  # a bingham's two sheets


def allowed(roughness: Tensor) -> Tensor:
    """Return the errors that are wanted.  [B]."""
    places, limits = np.array(ROUGHNESS_LIMITS).T
    return torch.from_numpy(np.interp(np.log(roughness), np.log(places), limits)).to(roughness)


def mix_errors(error: Tensor, scenes: Scenes, mixes: int) -> Tensor:
    """Return the errors of balls under mixes of the lobes, relative to the ball's light.  [B, X].

    Args:
        error: Of the lobes of amplitude 1.  [B, N, P]
        scenes: B scenes.
        mixes: X.
    """
    spread = FLUX_SPREAD * torch.randn(*scenes.flux.shape, mixes, dtype=torch.float64)
    flux = torch.softmax(spread, dim=1).to(error)
    amplitude = flux / scenes.flux[..., None]
    wrong = torch.einsum("bnp,bnx->bpx", error, amplitude).abs()
    light = torch.einsum("bnp,bnx->bpx", scenes.truth, amplitude)
    area = scenes.area[..., None]
    return (wrong * area).sum(1) / ((light * area).sum(1) + DARK)


def start(terms: int) -> Constants:
    """Return constants to start from: one Gaussian as wide as the distribution, others wider."""
    kernel = torch.zeros(DEGREES, 4 * terms, 4, dtype=torch.float64)
    kernel[0, 1:terms, 0] = 1.0
    kernel[0, terms : 2 * terms, 0] = torch.linspace(-0.7, 2.8, terms)
    share = torch.zeros(DEGREES, 9, dtype=torch.float64)
    share[0, :2], share[0, 6] = torch.tensor([0.1, 1.0]), -1.0
    return {"kernel": kernel, "share": share, "log_disc": torch.zeros(2, dtype=torch.float64)}


def fitted(scenes: dict[Form, Scenes], terms: int, steps: int) -> Constants:
    """Move the constants to where the errors are least."""
    ggx_lobes.TERMS = terms
    constants = start(terms)
    for values in constants.values():
        values.requires_grad_()
    optimiser = torch.optim.Adam(constants.values(), lr=LEARNING_RATE)
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimiser, max_lr=LEARNING_RATE, total_steps=steps, pct_start=0.1
    )
    for step in range(steps):
        optimiser.zero_grad()
        loss = 1e-5 * constants["kernel"].square().sum()  # holds what no scene decides
        for some in scenes.values():
            index = torch.randperm(len(some.roughness))[:BATCH]
            loss = loss + form_loss(constants, some.some(index))
        loss.backward()
        optimiser.step()
        schedule.step()
        if step % 50 == 0:
            print(f"step {step}: {loss.detach():.4f}", flush=True)
    return {name: values.detach() for name, values in constants.items()}


def form_loss(constants: Constants, scenes: Scenes) -> Tensor:
    """Return mean and fourth-power mean of the errors in units of what is wanted."""
    error = shown(constants, scenes) - scenes.truth
    errors = mix_errors(error, scenes, MIXES) / allowed(scenes.roughness)[:, None]
    tail = errors.clamp(max=OUTLIER).pow(4).mean().sqrt().sqrt()
    return errors.mean() + tail


def report(constants: Constants, scenes: dict[Form, Scenes]) -> None:
    """Print the errors of scenes that were not fitted: percent, mean and 95 % of the mixes."""
    errors = {
        form: mix_errors(shown(constants, some) - some.truth, some, mixes=20)
        for form, some in scenes.items()
    }
    print(f"| roughness | {' | '.join(scenes)} |\n|---|{'---|' * len(scenes)}")
    for low, high in pairwise((0.0, *REPORTED)):
        cells = []
        for form, some in scenes.items():
            inside = errors[form][(some.roughness > low) & (some.roughness <= high)]
            cells.append(f"{100 * inside.mean():.1f} {100 * inside.quantile(0.95):.1f}")
        print(f"| to {high:g} | {' | '.join(cells)} |")


def shipped() -> Constants:
    """Return the constants that asglight shades with."""
    kernel, share, disc = (
        torch.tensor(values, dtype=torch.float64)
        for values in (
            ggx_lobes_constants.KERNEL,
            ggx_lobes_constants.SHARE,
            ggx_lobes_constants.DISC,
        )
    )
    return {"kernel": kernel, "share": share, "log_disc": disc.log()}


def module(constants: Constants) -> str:
    """Return the source of the constants' module."""
    return f'''# SPDX-License-Identifier: Apache-2.0
"""The fitted constants of `asglight.shading.ggx_lobes`; by benchmarks/shaded/constants.py."""

KERNEL = {_literal(constants["kernel"])}
"""By degree of the Chebyshev polynomial of log(roughness), then the polynomial, then the power of
n.v. The polynomials, in the units of `ggx_lobes.kernel`: log of what stretches the distribution of
visible normals; log of the weights but the last, whose log is 0; for each Gaussian the log of the
variance along, the log of what is left of it across, and the shift."""

SHARE = {_literal(constants["share"])}
"""By degree, then: centre, log of the slope, weights of the ratio and of v.h; of the gain the log,
and its slope over the narrowness; log of what `ggx_layer.kept` loses; what
is added to the centre for window STEP, and for no window."""

DISC = {_literal(constants["log_disc"].exp())}
"""What the variance is multiplied by in `ggx_lobes.disc_mean`: window COSINE, window STEP."""
'''


def _literal(values: Tensor, indent: int = 0) -> str:
    if values.ndim == 1:
        return "(" + ", ".join(f"{v:.5f}" for v in values.tolist()) + ")"
    inner = "".join(f"{'':{indent + 4}}{_literal(v, indent + 4)},\n" for v in values)
    return f"(\n{inner}{'':{indent}})"


if __name__ == "__main__":
    main()
