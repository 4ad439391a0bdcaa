# SPDX-License-Identifier: Apache-2.0
"""Measure closed-form shading against brute force on the lobes fitted to real maps.

For every map and form, in percent: the error of a ball's light relative to it, the whole ball
together, at Fresnel reflectance 1 (in brackets: F0 = 0.04, the layer alone), and of a Lambertian
ball; first the worst of the views, which look at the map from all around, then their mean. No map
has been used to fit the constants. Six minutes for ten maps and four forms on an idle core.

    python -m benchmarks.shaded.balls --maps ../shared/hdri
"""

import argparse
import math
from collections.abc import Sequence
from pathlib import Path

import torch
from torch import Tensor

from asglight.fitting.options import FitOptions
from asglight.fitting.sequence import fit_frame
from asglight.lobes import Form, Lobes, asg
from asglight.shading import brute_force, ggx_lobes, rectified
from asglight.shading.sheets import amplitudes, sheets
from benchmarks.given import map_paths, read_map, refused_in_a_line

ROUGHNESS = (0.05, 0.07, 0.1, 0.15, 0.25, 0.35, 0.5, 0.7, 1.0)
F0 = (1.0, 0.04)
YAWS = (0, 90, 180, 270)
"""Degrees by which the lobes are turned about +Y under a view that stays."""
SAMPLES = 256
"""Of each sampler of the brute force: 0.06 to 0.2 % of a ball's light, against 8192."""
VIEW = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)


def main(argv: Sequence[str] | None = None) -> None:
    """Measure and print a Markdown table: each map for the first form, all together for each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--maps", type=Path, required=True, help="folder of latlong maps")
    parser.add_argument(
        "--forms", nargs="+", type=Form, default=list(Form), help="lobe forms (all)"
    )
    parser.add_argument("--points", type=int, default=200, help="points of a ball (200)")
    options = parser.parse_args(argv)
    first, paths = options.forms[0], map_paths(parser, options.maps)
    print(f"| {first} | " + " | ".join(map(str, ROUGHNESS)) + " | Lambert |")
    print("|---" * (len(ROUGHNESS) + 2) + "|")
    for form in options.forms:
        rows = []
        for path in paths:
            with refused_in_a_line(parser):
                lobes = fitted(path, form)
            seen = [errors(turned(lobes, yaw), options.points) for yaw in YAWS]
            rows += seen
            if form is first:
                _print_row(path.stem, torch.stack(seen))
        _print_row(f"**{form}, all**", torch.stack(rows))


def fitted(path: Path, form: Form) -> Lobes:
    """Fit 15 lobes to a map.  [15, .]."""
    return fit_frame(read_map(path), FitOptions(form=form), previous=None).lobes.to(torch.float64)


def turned(lobes: Lobes, yaw: float) -> Lobes:
    """Turn lobes about +Y.  [N, .].

    Args:
        lobes: N lobes, float64.  [N, .]
        yaw: Degrees.
    """
    cos, sin = math.cos(math.radians(yaw)), math.sin(math.radians(yaw))
    turn = torch.tensor([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]], dtype=torch.float64)
    return asg.rotate(lobes, turn)


def errors(lobes: Lobes, count: int) -> Tensor:
    """Return the relative errors of balls, the Lambertian one last.  [R + 1, F0]."""
    rows = []
    for roughness in ROUGHNESS:
        normals, area = brute_force.ball_points(lobes, roughness, count)
        parts = brute_force.reflected(lobes, normals, VIEW, roughness, SAMPLES)
        row = []
        for f0 in F0:
            colour = torch.full((3,), f0, dtype=torch.float64)
            weights = torch.tensor([f0, 1.0], dtype=torch.float64)
            truth = torch.einsum("npk,k,nc->pc", parts, weights, lobes.amplitude)
            shown = ggx_lobes.radiance(lobes, normals, VIEW, roughness, colour)
            row.append(_error(shown, truth, area))
        rows.append(torch.stack(row))
    normals, area = brute_force.ball_points(lobes, 1.0, count)
    unit = brute_force.irradiance_over_pi(lobes, normals, 1024)
    truth = torch.einsum("np,nc->pc", unit, lobes.amplitude)
    unit = rectified.irradiance_over_pi(sheets(lobes), normals)
    shown = torch.einsum("mp,mc->pc", unit, amplitudes(lobes))
    rows.append(_error(shown, truth, area).expand(len(F0)))
    return torch.stack(rows)


def _error(shown: Tensor, truth: Tensor, area: Tensor) -> Tensor:
    return ((shown - truth).abs() * area[:, None]).sum() / (truth * area[:, None]).sum()


def _print_row(name: str, rows: Tensor) -> None:
    """Print worst and mean of the errors of some views.  [V, R + 1, F0]."""
    both = 100 * torch.stack([rows.amax(0), rows.mean(0)], dim=-1)
    cells = [
        f"{white[0]:.1f} {white[1]:.1f} ({glass[0]:.1f} {glass[1]:.1f})"
        for white, glass in both[:-1].tolist()
    ]
    worst, mean = both[-1, 0].tolist()
    print(f"| {name} | " + " | ".join([*cells, f"{worst:.1f} {mean:.1f}"]) + " |", flush=True)


if __name__ == "__main__":
    main()
