# SPDX-License-Identifier: Apache-2.0
"""Balls under lobes in closed form against brute force in float64, and at their exact limits.

The ceilings are what a viewer promises; benchmarks/shaded/balls.py measures how far below them the
balls under real maps lie (docs/method/shading.md has the table).
"""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from places import SHARED

from asglight.fitting.first_frame.fit import FAST, fit_first_frame, soft_to_sharp
from asglight.fitting.options import LOBES
from asglight.images import open_sequence
from asglight.lobes import Form, Lobes, asg, frames
from asglight.shading import brute_force, ggx, ggx_lobes, rectified
from asglight.shading.sheets import amplitudes, sheets

HDRI = SHARED / "hdri"
MAPS = ("lobby", "sunset", "night")
BRIEF = replace(FAST, spreads_deg=FAST.spreads_deg[:1], levels=soft_to_sharp(rounds=1)[::2])
VIEW = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)
CEILINGS = {0.05: 0.03, 0.1: 0.03, 0.25: 0.04, 0.35: 0.08, 0.5: 0.08, 0.7: 0.09, 1.0: 0.03}
"""Of the light of a ball, by roughness."""
LAMBERT_CEILING = 0.02
LAMBERT_CEILING_OF_MAPS = 0.021
"""Of ten maps, `dawn` and `sunset` seen with the sun behind the ball: 2.06 and 2.05 %."""
POINTS = 512
"""Of the brute force: 0.2 % of a ball's light, measured against 16 times as many."""


def environment(form: Form, seed: int) -> Lobes:
    """Return lobes as a fit has them: broad sky, middling windows, sharp lamps.  [15, .]."""
    generator = torch.Generator().manual_seed(seed)
    axes = frames.axes_from_quaternion(torch.randn(15, 4, generator=generator).double())
    exponent = torch.tensor([-1.0] * 2 + [0.3] * 4 + [1.0] * 4 + [2.0] * 3 + [4.0] * 2)
    sharpness = 10 ** (exponent[:, None] + 0.7 * torch.rand(15, 2, generator=generator)).double()
    if form is Form.SG:
        sharpness = 2 * sharpness[:, :1].expand(-1, 2)
    colour = torch.rand(15, 3, generator=generator).double()
    lobes = Lobes(axes, sharpness.contiguous(), colour, form)
    return Lobes(axes, lobes.sharpness, colour / asg.integral(lobes)[:, None], form)


def ball_error(lobes: Lobes, roughness: float, f0: float, count: int = 60) -> float:
    """Return the error of a ball's light relative to it, the whole ball together."""
    normals, area = brute_force.ball_points(lobes, roughness, count)
    parts = brute_force.reflected(lobes, normals, VIEW, roughness, POINTS)
    truth = torch.einsum("npk,k,nc->pc", parts, torch.tensor([f0, 1.0]).double(), lobes.amplitude)
    colour = torch.full((3,), f0, dtype=torch.float64)
    shown = ggx_lobes.radiance(lobes, normals, VIEW, roughness, colour)
    area = area[:, None]
    return float(((shown - truth).abs() * area).sum() / (truth * area).sum())


def from_side(lobes: Lobes, yaw: float) -> Lobes:
    """Turn lobes about +Y by degrees, which is to look from another side."""
    cos, sin = math.cos(math.radians(yaw)), math.sin(math.radians(yaw))
    return asg.rotate(lobes, torch.tensor([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]]).double())


def lambert_error(lobes: Lobes) -> float:
    normals, area = brute_force.ball_points(lobes, 1.0, 100)
    truth = torch.einsum(
        "np,nc->pc", brute_force.irradiance_over_pi(lobes, normals, POINTS), lobes.amplitude
    )
    unit = rectified.irradiance_over_pi(sheets(lobes), normals)
    shown = torch.einsum("mp,mc->pc", unit, amplitudes(lobes))
    return float(((shown - truth).abs() * area[:, None]).sum() / (truth * area[:, None]).sum())


def sphere(rows: int) -> torch.Tensor:
    """Spread directions over the sphere, each for the same solid angle.  [3 rows^2, 3]."""
    z, turn = np.meshgrid(
        (np.arange(rows) + 0.5) * 2 / rows - 1,
        2 * np.pi * (np.arange(3 * rows) + 0.5) / (3 * rows),
        indexing="ij",
    )
    r = np.sqrt(1 - z * z)
    return torch.from_numpy(np.stack([r * np.cos(turn), r * np.sin(turn), z], -1).reshape(-1, 3))


@pytest.mark.parametrize(("form", "roughness"), [*zip(Form, (0.5, 1.0, 1.0, 0.5), strict=True)])
def test_brute_force_is_the_sum_over_a_grid(form: Form, roughness: float) -> None:
    lobes = environment(form, seed=0).select(torch.arange(6))  # the grid resolves the broad ones
    normals = torch.nn.functional.normalize(
        torch.tensor([[0.1, 0.2, 1.0], [0.7, -0.3, 0.6], [0.0, 0.9, 0.4]]).double(), dim=-1
    )
    light = sphere(420)
    half = torch.nn.functional.normalize(light + VIEW, dim=-1)
    n_l, n_h, n_v = normals @ light.T, normals @ half.T, normals[:, 2:]
    a2 = roughness**4
    distribution = a2 / math.pi / (n_h**2 * (a2 - 1) + 1) ** 2
    # Smith's Lambda of each direction, height-correlated [Heitz 2014].
    lambdas = [(torch.sqrt(1 + a2 * (1 / c**2 - 1)) - 1) / 2 for c in (n_v, n_l)]
    kernel = distribution / (1 + lambdas[0] + lambdas[1]) / (4 * n_v)
    kernel = torch.where(n_l > 0, kernel, 0.0) * (4 * math.pi / len(light))
    schlick = (1 - half[:, 2]) ** 5
    values = asg.unit_lobes(lobes, light)
    expected = torch.stack(
        [values @ (kernel * (1 - schlick)).T, values @ (kernel * schlick).T], dim=-1
    )
    found = brute_force.reflected(lobes, normals, VIEW, roughness, 4096)
    # The kink at the horizon costs the grid 1e-3; a twelfth of the light or less is that dark.
    torch.testing.assert_close(found, expected, rtol=4e-3, atol=1e-3 * float(expected.max()))


@pytest.mark.parametrize("form", Form)
def test_points_of_a_ball_find_what_it_mirrors(form: Form) -> None:
    # Of a mirror ball seen from far away, dw = 4 dA: its image holds a quarter of all light.
    lobes = environment(form, seed=5)
    flux = (asg.integral(lobes)[:, None] * lobes.amplitude).sum(0)
    normals, area = brute_force.ball_points(lobes, 0.05, 800)
    assert float(area.sum()) == pytest.approx(math.pi, rel=0.03)
    # it is few points of the ball that err; of its light, 128 and 512 differ by 0.04 %
    parts = brute_force.reflected(lobes, normals, VIEW, 0.05, 128)
    light = torch.einsum("npk,nc,p->c", parts, lobes.amplitude, area)
    # 1.6 % at most; the albedo is 1 to 3e-5.
    torch.testing.assert_close(light, flux / 4, rtol=0.03, atol=0)


@pytest.mark.parametrize("roughness", CEILINGS)
@pytest.mark.parametrize("form", Form)
def test_closed_form_follows_brute_force(form: Form, roughness: float) -> None:
    assert ball_error(environment(form, seed=1), roughness, f0=1.0) < CEILINGS[roughness]


@pytest.mark.parametrize("form", Form)
def test_closed_form_of_lambert_follows_brute_force(form: Form) -> None:
    assert lambert_error(environment(form, seed=2)) < LAMBERT_CEILING


@pytest.mark.skipif(not HDRI.is_dir(), reason=f"the maps are not there: {HDRI}")
@pytest.mark.parametrize("name", MAPS)
def test_closed_form_follows_brute_force_on_fits_of_maps(name: str) -> None:
    sequence = open_sequence(HDRI / f"{name}.exr", height=64)
    radiance = sequence.read(sequence.frames[0]).radiance
    lobes = fit_first_frame(radiance, LOBES, Form.ASG, BRIEF).lobes.to(torch.float64)
    seen = {yaw: from_side(lobes, yaw) for yaw in (0, 90, 180, 270)}
    # each roughness from one side, of each map from another
    yaws = itertools.islice(itertools.cycle(seen), MAPS.index(name), None)
    for (roughness, ceiling), yaw in zip(CEILINGS.items(), yaws, strict=False):
        assert ball_error(seen[yaw], roughness, f0=1.0) < ceiling, (yaw, roughness)
    for yaw, lobes in seen.items():
        assert lambert_error(lobes) < LAMBERT_CEILING_OF_MAPS, yaw


@pytest.mark.parametrize("form", Form)
@pytest.mark.parametrize("sharpness", [0.1, 1.0, 10.0])
def test_the_roughest_layer_depends_on_two_cosines(form: Form, sharpness: float) -> None:
    # At a roughness of 1, f n.l is n.l / (2 pi (n.l + n.v)): the sum over a grid of the sphere.
    axes = frames.axes_from_quaternion(torch.tensor([[0.3, 0.8, -0.1, 0.5]]).double())
    lobes = Lobes(axes, torch.full((1, 2), sharpness).double(), torch.ones(1, 3).double(), form)
    normals, area = brute_force.ball_points(lobes, 1.0, 100)
    light = sphere(60)
    n_l, n_v = (normals @ light.T).clamp(min=0), normals[:, 2:]
    cell = 4 * math.pi / len(light)
    truth = (n_l / (2 * math.pi * (n_l + n_v))) @ asg.unit_lobes(lobes, light)[0] * cell
    shown = ggx_lobes.radiance(lobes, normals, VIEW, 1.0, torch.ones(3).double())[:, 0]
    error = float(((shown - truth).abs() * area).sum() / (truth * area).sum())
    # Two nodes for a light that is not normal: 2 % of a lobe in front of the ball, 4 % behind it.
    assert error < 0.04


@pytest.mark.parametrize("form", Form)
def test_a_point_light_shows_the_reflectance_itself(form: Form) -> None:
    lamp = torch.nn.functional.normalize(torch.tensor([[0.5, -0.3, 0.6]]).double(), dim=-1)
    sharpness = torch.full((1, 2), 1e6).double()
    lobes = Lobes(frames.axes_around(lamp), sharpness, torch.ones(1, 3).double(), form)
    flux = float(asg.integral(lobes)[0]) / (2 if form is Form.BINGHAM else 1)
    normals = torch.nn.functional.normalize(lamp + VIEW + 0.2 * torch.eye(3).double(), dim=-1)
    half = torch.nn.functional.normalize(lamp + VIEW, dim=-1)
    n_l, n_h = (normals @ lamp.T)[:, 0], (normals @ half.T)[:, 0]
    value = ggx.distribution(1 - n_h**2, 0.25) * ggx.visibility(normals[:, 2], n_l, 0.25) * n_l
    fresnel = 0.04 + 0.96 * (1 - half[0, 2]) ** 5
    f0 = torch.full((3,), 0.04).double()
    shown = ggx_lobes.radiance(lobes, normals, VIEW, 0.5, f0)[:, 0]
    # The lamp's deviation of 7e-4 widens a distribution of 0.25 by 1e-5.
    torch.testing.assert_close(shown, value * fresnel * flux, rtol=1e-4, atol=0)


@pytest.mark.parametrize(
    ("roughness", "rtol", "atol"),
    # A roughness of 1 has `narrow` alone, whose two nodes stand for light from everywhere.
    [(0.05, 2e-3, 0.0), (0.3, 2e-3, 0.0), (1.0, 0.0, 0.015)],
)
def test_an_even_light_shows_the_albedo(roughness: float, rtol: float, atol: float) -> None:
    # Without a window a sharpness of 1e-3 is even to 0.2 %.
    lobes = Lobes(
        torch.eye(3).double()[None], torch.full((1, 2), 1e-3).double(), torch.ones(1, 3).double(),
        Form.SG,
    )  # fmt: skip
    cos_view = torch.tensor([0.2, 0.6, 1.0]).double()
    normals = torch.stack([(1 - cos_view**2).sqrt(), torch.zeros(3).double(), cos_view], dim=-1)
    f0 = torch.tensor([1.0, 0.3, 0.04]).double()
    parts = ggx.albedo_parts(cos_view, roughness**2)
    expected = parts[:, :1] * f0 + parts[:, 1:]
    shown = ggx_lobes.radiance(lobes, normals, VIEW, roughness, f0)
    torch.testing.assert_close(shown, expected, rtol=rtol, atol=atol)


def test_a_smooth_ball_mirrors_broad_lobes() -> None:
    lobes = environment(Form.ASG, seed=3).select(torch.arange(6))
    normals, _ = brute_force.ball_points(lobes, 0.5, 40)
    normals = normals[normals[:, 2] > 0.5]
    mirrored = 2 * normals[:, 2:] * normals - VIEW
    albedo = ggx.albedo(normals[:, 2], 0.05**2)[:, None]
    shown = ggx_lobes.radiance(lobes, normals, VIEW, 0.05, torch.ones(3).double())
    expected = asg.evaluate(lobes, mirrored) * albedo
    # The blur of 0.3 degrees, whose tails are long, moves 1 % of the light.
    assert (shown - expected).abs().max() < 0.01 * expected.max()


@pytest.mark.parametrize(("beyond", "nearest"), [(0.0, 0.05), (1e-3, 0.05), (1.2, 1.0)])
def test_a_roughness_out_of_range_shows_the_nearest_in_it(beyond: float, nearest: float) -> None:
    # At a roughness of 0 the distribution is 0 / 0.
    lobes = environment(Form.ASG, seed=4)
    normals, _ = brute_force.ball_points(lobes, 0.5, 40)
    f0 = torch.tensor([1.0, 0.3, 0.04]).double()
    shown, wanted = (ggx_lobes.radiance(lobes, normals, VIEW, r, f0) for r in (beyond, nearest))
    torch.testing.assert_close(shown, wanted, rtol=1e-12, atol=0)


def test_turning_everything_changes_nothing() -> None:
    lobes = environment(Form.ASG, seed=4)
    normals, _ = brute_force.ball_points(lobes, 0.5, 40)
    turn = frames.axes_from_quaternion(torch.tensor([0.2, 0.5, -0.7, 0.4]).double())
    f0 = torch.ones(3).double()
    before = ggx_lobes.radiance(lobes, normals, VIEW, 0.3, f0)
    turned = asg.rotate(lobes, turn)
    after = ggx_lobes.radiance(turned, normals @ turn.T, turn @ VIEW, 0.3, f0)
    torch.testing.assert_close(after, before, rtol=1e-9, atol=1e-12)
    per_point = (turn @ VIEW).expand(len(normals), 3)
    again = ggx_lobes.radiance(turned, normals @ turn.T, per_point, 0.3, f0)
    torch.testing.assert_close(again, after, rtol=1e-12, atol=0)


@pytest.mark.parametrize("form", Form)
@pytest.mark.parametrize("sharpness", [1e-3, 1.0, 1e3, 1e7])
def test_no_light_and_no_normal_gives_a_nan(form: Form, sharpness: float) -> None:
    directions = torch.tensor([[0, 0, 1], [0, 0, -1], [1, 0, 0], [0.6, 0, 0.8]]).double()
    axes = frames.axes_around(directions)
    lobes = Lobes(axes, torch.full((4, 2), sharpness).double(), torch.ones(4, 3).double(), form)
    lobes.sharpness[:, 1] = max(sharpness / 400, 1e-3) if form is not Form.SG else sharpness
    normals = torch.tensor([[0, 0, 1], [1, 0, 0], [0.6, 0, 0.8], [0.3162, 0, 0.9487]]).double()
    for dtype in (torch.float32, torch.float64):
        for roughness in (0.05, 0.5, 1.0):
            f0 = torch.ones(3, dtype=dtype)
            shown = ggx_lobes.radiance(
                lobes.to(dtype), normals.to(dtype), VIEW.to(dtype), roughness, f0
            )
            assert shown.dtype == dtype
            assert shown.isfinite().all()
            assert (shown >= 0).all()


@pytest.mark.parametrize("form", Form)
def test_a_light_behind_the_ball_makes_no_bright_dot_in_its_middle(form: Form) -> None:
    behind = torch.tensor([[0.0, 0.0, -1.0]]).double()
    sharpness = torch.full((1, 2), 1.0).double()
    lobes = Lobes(frames.axes_around(behind), sharpness, torch.ones(1, 3).double(), form)
    x = torch.tensor([0.0, 1e-7, 1e-4, 1e-2]).double()
    normals = torch.stack([x, torch.zeros(4).double(), (1 - x * x).sqrt()], dim=-1)
    shown = ggx_lobes.radiance(lobes, normals, VIEW, 0.3, torch.ones(3).double())
    # Nothing is that sharp in a ball of this roughness; a window leaves less than 1e-6 there.
    torch.testing.assert_close(shown, shown[3:].expand(4, 3), rtol=2e-3, atol=1e-6)


@pytest.mark.parametrize("form", [Form.ASG, Form.SG])  # a bingham lobe has a twin in front
@pytest.mark.parametrize(("roughness", "sharpness"), [(0.15, 1e4), (0.25, 1.6e3), (0.4, 300.0)])
def test_a_lamp_straight_behind_stays_behind(
    form: Form, roughness: float, sharpness: float
) -> None:
    # About as wide as the reflection, where `broad` alone shows as much of it as of any lamp.
    axes = frames.axes_around(-VIEW[None])
    lobes = Lobes(axes, torch.full((1, 2), sharpness).double(), torch.ones(1, 3).double(), form)
    flux = float(asg.integral(lobes)[0])
    x = ((torch.arange(400) + 0.5) / 400).double().sqrt()  # rings of the same area
    normals = torch.stack([x, 0 * x, (1 - x * x).sqrt()], dim=-1)
    truth = brute_force.reflected(lobes, normals, VIEW, roughness, POINTS).sum(-1)[0]
    shown = ggx_lobes.radiance(lobes, normals, VIEW, roughness, torch.ones(3).double())[:, 0]
    mirrored = flux / 4 / math.pi  # what a mirror ball shows of a lamp that is anywhere else
    assert float(truth.mean()) < 0.04 * mirrored
    # `ggx_layer.kept` knows only how far behind a lamp is; without it, 12 to 44 % of that.
    assert float((shown - truth).abs().mean()) < 0.1 * mirrored


def test_no_lobes_show_nothing() -> None:
    none = environment(Form.BINGHAM, seed=0).select(torch.arange(0))
    shown = ggx_lobes.radiance(none, VIEW[None], VIEW, 0.3, torch.ones(3).double())
    assert torch.equal(shown, torch.zeros(1, 3).double())
