# SPDX-License-Identifier: Apache-2.0
"""Fit the constants of asglight.shading.ggx_lobes to random lobes and write them.

Lobes of all forms, sharpness 0.1 to 2e5 and ratio 1 to 40, each under its own roughness and seen
from its own side, are integrated by brute force at points all over the ball and around the
highlight. Adam then moves the constants so that the error of a ball's light, relative to it, is
small on average and squared. No map is used. About eight minutes on one core.

    python benchmarks/fit_shading.py
"""

import argparse
import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import torch
from torch import Tensor

from asglight.lobes import Form, Lobes, frames
from asglight.shading import brute_force, ggx, ggx_layer, ggx_lobes
from asglight.shading.sheets import Sheets, Window, sheets

OUTPUT = Path(ggx_lobes.__file__).with_name("ggx_lobes_constants.py")
VIEW = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)
FORMS = [Form.ASG] * 5 + [Form.SG] + [Form.BINGHAM] * 2
"""The forms in turn; of each the mean error counts as much as FORM_WEIGHTS says."""
FORM_WEIGHTS = {Form.ASG: 1.0, Form.SG: 0.2, Form.BINGHAM: 0.5}
POINTS = 120
DEGREES = 5
"""Chebyshev polynomials of log(roughness)."""
STEPS = 900
LEARNING_RATE = 0.05
BATCHES = 8
"""A step takes one of so many of the lobes."""
DARK = 0.05
"""Share of a lobe's integral that is added to the light of its ball: a lobe behind the ball, which
shows almost nothing, is no reason to bend the constants."""

Constants = dict[str, Tensor]


class Samples(NamedTuple):
    """B lobes of one form, each on its own ball.

    Attributes:
        roughness: [B]
        sheets: With a dimension of points.  [B, M, 1, .]
        normals: [B, 1, P, 3]
        area: Of the ball's image that a point stands for.  [B, P]
        albedo: [B, 1, P]
        truth: Reflected at Fresnel reflectance 1.  [B, P]
    """

    roughness: Tensor
    sheets: Sheets
    normals: Tensor
    area: Tensor
    albedo: Tensor
    truth: Tensor

    def some(self, index: Tensor) -> "Samples":
        """Pick lobes."""
        *numbers, window = self.sheets
        axes, disc_variance, integral, mean, variance = (values[index] for values in numbers)
        return Samples(
            self.roughness[index],
            Sheets(axes, disc_variance, integral, mean, variance, window),
            self.normals[index],
            self.area[index],
            self.albedo[index],
            self.truth[index],
        )


def main(argv: Sequence[str] | None = None) -> None:
    """Sample, fit, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--lobes", type=int, default=4000, help="random lobes (4000)")
    parser.add_argument("--terms", type=int, default=3, help="Gaussians of the kernel (3)")
    parser.add_argument("-o", "--output", type=Path, default=OUTPUT, help="the constants' module")
    options = parser.parse_args(argv)
    torch.manual_seed(0)
    samples = {form: draw(form, options.lobes) for form in Form}
    constants = fitted(samples, options.terms)
    for form in Form:
        errors = ball_errors(constants, samples[form]).detach()
        print(f"{form}: mean {errors.mean():.2%}, 95 % of lobes below {errors.quantile(0.95):.2%}")
    options.output.write_text(module(constants))


def draw(form: Form, total: int) -> Samples:
    """Draw a form's share of random lobes and integrate them."""
    count = total * FORMS.count(form) // len(FORMS)
    roughness = 0.05 * 20 ** torch.rand(count, dtype=torch.float64)
    s = 10 ** (-1 + 6.3 * torch.rand(count, dtype=torch.float64))
    ratio = 10 ** (1.6 * torch.rand(count, dtype=torch.float64))
    round_ones = torch.rand(count) < (1.0 if form is Form.SG else 0.25)
    root = torch.where(round_ones, 1.0, ratio).sqrt()
    axes = frames.axes_from_quaternion(torch.randn(count, 4, dtype=torch.float64))
    lobes = Lobes(
        axes[:, None],
        torch.stack([s * root, s / root], dim=-1)[:, None],
        torch.ones(count, 1, 3, dtype=torch.float64),
        form,
    )
    normals, area, albedo, truth = [], [], [], []
    for index in range(count):
        n, a = points(lobes[index], float(roughness[index]))
        rough, draws = float(roughness[index]), 1024 if s[index] < 300 else 512
        parts = brute_force.reflected(lobes[index], n, VIEW, rough, draws)
        normals.append(n)
        area.append(a)
        albedo.append(ggx.albedo(n[:, 2], rough**2))
        truth.append(parts[0].sum(-1))
    return Samples(
        roughness,
        sheets(lobes).over_points(),
        torch.stack(normals)[:, None],
        torch.stack(area),
        torch.stack(albedo)[:, None],
        torch.stack(truth),
    )


def points(lobe: Lobes, roughness: float) -> tuple[Tensor, Tensor]:
    """Return normals anywhere and at three distances from the highlight, and their areas."""
    axis_z = lobe.axis_z[0]
    axis_z = -axis_z if lobe.form is Form.BINGHAM and axis_z[2] < 0 else axis_z
    half = axis_z + VIEW
    centre = (half / half.norm().clamp(min=1e-3))[:2]
    width = math.sqrt(0.5 * roughness**4 + 0.125 / float(lobe.sharpness.min()))
    scales = (width * torch.tensor([0.7, 2.0, 6.0], dtype=torch.float64)).clamp(max=0.5)
    seed = int(torch.randint(2**30, (1,)))
    engine = torch.quasirandom.SobolEngine(3, scramble=True, seed=seed)
    u = engine.draw(32 * POINTS, dtype=torch.float64)
    turn = 2 * math.pi * u[:, 1]
    around = torch.stack([turn.cos(), turn.sin()], dim=-1)
    which = (4 * u[:, 2]).long() - 1
    near = (-2 * torch.log1p(-u[:, 0])).sqrt() * scales[which.clamp(min=0)]
    place = torch.where(
        (which < 0)[:, None], u[:, :1].sqrt() * around, centre + near[:, None] * around
    )
    place = place[place.square().sum(-1) < 0.9995][:POINTS]
    distance2 = (place - centre).square().sum(-1)[:, None]
    bells = torch.exp(-distance2 / (2 * scales**2)) / (2 * math.pi * scales**2)
    density = 0.25 / math.pi + 0.25 * bells.sum(-1)
    z = (1 - place.square().sum(-1)).sqrt()
    return torch.cat([place, z[:, None]], dim=-1), 1 / density / len(place)


def shown(constants: Constants, samples: Samples) -> Tensor:
    """Return what the closed form shows.  [B, P]."""
    layer = ggx_layer.layer_from(
        samples.roughness[:, None], constants["kernel"], constants["share"]
    )
    over_points = ggx_layer.Layer(layer.alpha[:, None], layer.kernel[:, None], layer.share[:, None])
    at_sheets = over_points._replace(kernel=layer.kernel, share=layer.share[:, None])
    made, seen = samples.sheets, ggx_lobes.surface(samples.normals, VIEW)
    places = {Window.COSINE: 0, Window.STEP: 1}
    unmoved = made.window is Window.COSINE
    moved = 0.0 if unmoved else constants["move"][0 if made.window is Window.STEP else 1]
    disc = constants["log_disc"][places[made.window]].exp() if made.window in places else 0.25
    part = ggx_layer.share(made, at_sheets, moved)
    blurred = ggx_lobes.broad(made, ggx_lobes.kernel(seen, over_points), disc)
    tilted = ggx_layer.tilt(made, VIEW, over_points)
    mirrored = ggx_lobes.narrow(made, tilted, seen, over_points)
    return (part * mirrored + (1 - part) * samples.albedo * blurred).sum(1)


def ball_errors(constants: Constants, samples: Samples) -> Tensor:
    """Return the error of each ball's light relative to it.  [B]."""
    error = ((shown(constants, samples) - samples.truth).abs() * samples.area).sum(1)
    light = (samples.truth * samples.area).sum(1)
    return error / (light + DARK * samples.sheets.integral.sum((1, 2)))


def start(terms: int) -> Constants:
    """Return constants to start from: one Gaussian as wide as the distribution, others wider."""
    kernel = torch.zeros(DEGREES, 4 * terms, 4, dtype=torch.float64)
    kernel[0, 1:terms, 0] = 1.0
    kernel[0, terms : 2 * terms, 0] = torch.linspace(-0.7, 2.8, terms)
    share = torch.zeros(DEGREES, 4, dtype=torch.float64)
    share[0, :2] = torch.tensor([0.1, 1.0])
    both = torch.zeros(2, dtype=torch.float64)
    return {"kernel": kernel, "share": share, "log_disc": both.clone(), "move": both}


def fitted(samples: dict[Form, Samples], terms: int) -> Constants:
    """Move the constants to where the errors are least."""
    ggx_lobes.TERMS = terms
    constants = start(terms)
    for values in constants.values():
        values.requires_grad_()
    optimiser = torch.optim.Adam(constants.values(), lr=LEARNING_RATE)
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimiser, max_lr=LEARNING_RATE, total_steps=STEPS, pct_start=0.2
    )
    for step in range(STEPS):
        optimiser.zero_grad()
        loss = 1e-5 * constants["kernel"].square().sum()  # holds what no lobe decides
        for form, weight in FORM_WEIGHTS.items():
            count = len(samples[form].roughness)
            some = samples[form].some(torch.randperm(count)[: max(1, count // BATCHES)])
            errors = ball_errors(constants, some)
            loss = loss + weight * (errors.mean() + 2 * errors.square().mean())
        loss.backward()
        optimiser.step()
        schedule.step()
        if step % 50 == 0:
            print(f"step {step}: {loss.detach():.4f}", flush=True)
    return {name: values.detach() for name, values in constants.items()}


def module(constants: Constants) -> str:
    """Return the source of the constants' module."""
    return f'''# SPDX-License-Identifier: Apache-2.0
"""The fitted constants of `asglight.shading.ggx_lobes`; written by benchmarks/fit_shading.py."""

KERNEL = {_literal(constants["kernel"])}
"""By degree of the Chebyshev polynomial of log(roughness), then the polynomial, then the power of
n.v. The polynomials, in the units of `ggx_lobes.kernel`: log of what stretches the distribution of
visible normals; log of the weights but the last, whose log is 0; for each Gaussian the log of the
variance along, the log of what is left of it across, and the shift."""

SHARE = {_literal(constants["share"])}
"""By degree, then: centre, log of the slope, weight of the ratio, log of the gain."""

DISC = {_literal(constants["log_disc"].exp())}
"""What the variance is multiplied by in `ggx_lobes.disc_mean`: window COSINE, window STEP."""

MOVE = {_literal(constants["move"])}
"""What is added to the centre of the share: window STEP, no window."""
'''


def _literal(values: Tensor, indent: int = 0) -> str:
    if values.ndim == 1:
        return "(" + ", ".join(f"{v:.5f}" for v in values.tolist()) + ")"
    inner = "".join(f"{'':{indent + 4}}{_literal(v, indent + 4)},\n" for v in values)
    return f"(\n{inner}{'':{indent}})"


if __name__ == "__main__":
    main()
