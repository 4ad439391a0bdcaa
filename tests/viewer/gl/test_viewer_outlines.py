# SPDX-License-Identifier: Apache-2.0
"""Outlines are the true level curves, whole wherever they lie on the map; picking agrees."""

import math

import numpy as np
import pytest
import torch
from effort import tries
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.path import Path as Polygon
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from asglight.lobes import Form, Lobes, asg
from asglight.luminance import luminance
from asglight.sphere import latlong
from asglight.viewer.state.picking import brightest_first, contributions, energies, pick
from asglight.viewer.uniforms.outlines import HALF_PEAK, half_angles, outlines
from asglight.viewer.uniforms.polylines import STEP_MAX

LEVELS = (HALF_PEAK, math.exp(-2))
SHARPNESS = (1e-3, 0.1, 0.5, 1.0, 3.0, 30.0, 1e3, 1e5, 1e7)


def lobes_of(
    sharpness, turns: Rotation | None = None, form: Form = Form.ASG, amplitude: float = 1.0
) -> Lobes:
    """Return float64 lobes, turned at random unless told otherwise."""
    count = len(sharpness)
    turns = Rotation.random(count, rng=np.random.default_rng(count)) if turns is None else turns
    axes = np.swapaxes(turns.as_matrix().reshape(-1, 3, 3), -1, -2).copy()
    return Lobes(
        torch.from_numpy(axes),
        torch.tensor(sharpness, dtype=torch.float64),
        torch.full((count, 3), amplitude, dtype=torch.float64),
        form,
    )


def facing(*directions: tuple[float, float, float]) -> Rotation:
    """Return the rotations that take +Z to each direction, with some twist about it."""
    turns = [Rotation.align_vectors([d], [(0, 0, 1)])[0] for d in np.array(directions, float)]
    return Rotation.concatenate(turns) * Rotation.from_rotvec([0, 0, 0.3])


def directions(uv: np.ndarray) -> torch.Tensor:
    return latlong.direction_from_uv(*torch.from_numpy(uv).unbind(-1))


def off_the_edge(uv: np.ndarray) -> np.ndarray:
    """Leave out the points between two samples, which are set on the seam and on the poles."""
    return uv[((uv > 0) & (uv < 1)).all(-1)]


def values(lobe: Lobes, uv: np.ndarray) -> np.ndarray:
    return asg.evaluate(lobe, directions(off_the_edge(uv)))[:, 0].numpy()


def length(pieces) -> float:
    """Return the length of polylines on the sphere, in radians."""
    points = [directions(piece) for piece in pieces]
    return sum(float(torch.diff(p, dim=0).norm(dim=-1).sum()) for p in points)


def every_pair(form: Form) -> list[tuple[float, float]]:
    if form is Form.SG:
        return [(s, s) for s in SHARPNESS]
    return [(sx, sy) for sx in SHARPNESS for sy in SHARPNESS]


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("form", Form)
def test_every_point_of_a_curve_is_at_the_level(form, level):
    lobes = lobes_of(every_pair(form), form=form)
    drop = -math.log(level)
    for index, outline in enumerate(outlines(lobes, level)):
        lobe = lobes.select(torch.tensor([index]))
        reached = float(lobe.sharpness.max()) > (drop / 2 if form is Form.SG else drop)
        for curve in outline.curves:
            if form in (Form.ASG, Form.FLAT) or reached:
                # float64 rounding of uv times the slope of the sharpest lobe: 1e-15 * 3e3;
                # of the thinnest band 1 - t is 7e-8, known to 2e-16
                tolerance = 1e-8 if form is Form.BINGHAM else 1e-10
                np.testing.assert_allclose(values(lobe, curve), level, rtol=tolerance)
            else:
                z = directions(off_the_edge(curve)) @ lobe.axis_z[0]
                np.testing.assert_allclose(z, 0, atol=3e-8)  # the root of float64 rounding
            assert (curve >= 0).all()
            assert (curve <= 1).all()


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("sharpness", SHARPNESS)
def test_half_angles_of_an_asg_are_the_root_along_each_axis(sharpness, level):
    def excess(angle: float, s: float) -> float:
        return math.log(math.cos(angle)) - s * math.sin(angle) ** 2 - math.log(level)

    found = half_angles(lobes_of([(sharpness, 2.0)]), level)[0]
    for angle, s in zip(found.tolist(), (sharpness, 2.0), strict=True):
        wanted = brentq(lambda a, s=s: excess(a, s), 0, math.pi / 2 - 1e-9, xtol=1e-15)
        # the root's own tolerance, relative to the narrowest lobe's 2.6e-4 radians
        assert angle == pytest.approx(wanted, rel=1e-10)


@pytest.mark.parametrize("form", Form)
@pytest.mark.parametrize("sharpness", [2.0, 40.0, 1e5])
def test_a_round_lobe_has_a_circle_of_the_closed_form(form, sharpness):
    def asg_excess(angle: float) -> float:
        return math.cos(angle) * math.exp(-sharpness * math.sin(angle) ** 2) - 0.5

    def flat_excess(angle: float) -> float:
        gaussian = math.exp(-sharpness * math.sin(angle) ** 2)
        return math.cos(angle) * (1 - (1 - gaussian) ** 3) - 0.5

    angle = {
        Form.ASG: brentq(asg_excess, 0, 1.5, xtol=1e-15),
        Form.FLAT: brentq(flat_excess, 0, 1.5, xtol=1e-15),
        Form.BINGHAM: math.asin(math.sqrt(math.log(2) / sharpness)),
        Form.SG: math.acos(1 - math.log(2) / sharpness),
    }[form]
    lobe = lobes_of([(sharpness, sharpness)], form=form)
    (outline,) = outlines(lobe)
    for curve in outline.curves:
        z = directions(off_the_edge(curve)) @ lobe.axis_z[0]
        # near 1 a cosine loses half its digits
        np.testing.assert_allclose(z.abs().arccos(), angle, rtol=1e-5)
    sides = 2 if form is Form.BINGHAM else 1
    # 64 chords are 4e-4 shorter than the circle
    assert length(outline.curves) == pytest.approx(sides * 2 * math.pi * math.sin(angle), rel=1e-3)


def test_a_bingham_lobe_of_one_small_sharpness_is_a_band_with_two_edges():
    lobe = lobes_of([(8.0, 0.2)], form=Form.BINGHAM, turns=facing((0.2, 0.1, 1.0)))
    (outline,) = outlines(lobe)
    sides = [torch.sign(directions(c) @ lobe.axis_x[0]).unique().tolist() for c in outline.curves]
    assert sorted(s for side in sides for s in set(side)) in ([-1, 1], [-1, -1, 1], [-1, 1, 1])
    np.testing.assert_allclose(half_angles(lobe)[0, 1], math.pi / 2)


@pytest.mark.thorough
@settings(max_examples=tries(60), deadline=None)
@given(
    seed=st.integers(0, 10_000),
    sharpness=st.tuples(*[st.sampled_from([0.01, 0.9, 4.0, 50.0, 3e3])] * 2),
    form=st.sampled_from(list(Form)),
)
def test_a_curve_is_whole_wherever_it_lies(seed, sharpness, form):
    """Turning the lobe changes neither its outline's length nor that of its arms."""
    sharpness = (sharpness[0],) * 2 if form is Form.SG else sharpness
    middle = outlines(lobes_of([sharpness], facing((0.0, 0.0, 1.0)), form))[0]
    turns = Rotation.random(1, rng=np.random.default_rng(seed))
    turned = outlines(lobes_of([sharpness], turns, form))[0]
    for name in ("curves", "arm_x", "arm_y"):
        pieces = getattr(turned, name)
        assert_nothing_crosses_the_map(pieces)
        # where one is drawn more finely than the other, its chords are longer by 4e-4; the points
        # set on the seam are a chord's sagitta off
        assert length(pieces) == pytest.approx(length(getattr(middle, name)), rel=2e-3)


def assert_nothing_crosses_the_map(pieces) -> None:
    for piece in pieces:
        assert np.abs(np.diff(piece[:, 0])).max() <= STEP_MAX
        assert np.isfinite(piece).all()


def ends(pieces) -> np.ndarray:
    return np.array([[piece[0], piece[-1]] for piece in pieces])  # [pieces, 2, 2]


def test_an_outline_over_the_seam_is_cut_in_two_that_meet():
    pieces = outlines(lobes_of([(40.0, 10.0)], facing((0.05, 0.2, -1.0))))[0].curves
    assert len(pieces) == 2
    assert_nothing_crosses_the_map(pieces)
    first, second = ends(pieces)
    assert set(first[:, 0]) | set(second[:, 0]) == {0.0, 1.0}
    assert first[0, 0] == first[1, 0] != second[0, 0] == second[1, 0]
    np.testing.assert_allclose(sorted(first[:, 1]), sorted(second[:, 1]), atol=1e-15)


def test_an_outline_centred_on_the_seam_has_equal_halves():
    lobe = lobes_of([(10.0, 10.0)], Rotation.from_euler("y", math.pi))
    pieces = outlines(lobe)[0].curves
    assert_nothing_crosses_the_map(pieces)
    assert length(pieces) == pytest.approx(2 * length(pieces[:1]), rel=1e-6)


@pytest.mark.parametrize("up", [1.0, -1.0])
def test_an_outline_around_a_pole_runs_from_edge_to_edge(up):
    pieces = outlines(lobes_of([(5.0, 5.0)], facing((0.0, up, 0.0))))[0].curves
    assert len(pieces) == 1
    assert_nothing_crosses_the_map(pieces)
    assert sorted(pieces[0][[0, -1], 0]) == [0.0, 1.0]
    angle = float(half_angles(lobes_of([(5.0, 5.0)]))[0, 0])
    np.testing.assert_allclose(pieces[0][:, 1], 0.5 - up * (0.5 - angle / math.pi), rtol=1e-9)


@pytest.mark.parametrize("off", [0.0, 1e-9, 1e-3, -1e-3])
def test_an_outline_through_a_pole_goes_up_to_it_and_comes_down_elsewhere(off):
    angle = float(half_angles(lobes_of([(5.0, 5.0)]))[0, 0]) + off
    lobe = lobes_of([(5.0, 5.0)], facing((0.0, math.cos(angle), math.sin(angle))))
    pieces = outlines(lobe)[0].curves
    assert_nothing_crosses_the_map(pieces)
    top = min(piece[:, 1].min() for piece in pieces)
    assert top == pytest.approx(abs(off) / math.pi, abs=1e-6)
    circle = 2 * math.pi * math.sin(angle - off)
    assert length(pieces) == pytest.approx(circle, rel=1e-3)  # of 64 chords: 4e-4 shorter


def test_arms_of_a_lobe_at_a_pole_are_cut_there():
    (outline,) = outlines(lobes_of([(5.0, 20.0)], facing((0.0, 1.0, 0.0))))
    for axis, arm in enumerate((outline.arm_x, outline.arm_y)):
        assert len(arm) == 2
        assert_nothing_crosses_the_map(arm)
        for piece in arm:  # a meridian, of points down to 1e-7 from the pole
            np.testing.assert_allclose(np.ptp(piece[:, 0]), 0, atol=1e-8)
        angle = float(half_angles(lobes_of([(5.0, 20.0)]))[0, axis])
        assert length(arm) == pytest.approx(2 * angle, rel=1e-3)


@pytest.mark.parametrize("form", Form)
def test_arms_end_on_the_outline_and_lie_along_their_axes(form):
    sharpness = (30.0, 30.0) if form is Form.SG else (30.0, 4.0)
    lobe = lobes_of([sharpness], facing((0.3, 0.2, 1.0)), form)
    (outline,) = outlines(lobe)
    across = (lobe.axis_y[0], lobe.axis_x[0])
    for arm, other in zip((outline.arm_x, outline.arm_y), across, strict=True):
        np.testing.assert_allclose(values(lobe, ends(arm).reshape(-1, 2)), 0.5, rtol=1e-10)
        for piece in arm:
            np.testing.assert_allclose(directions(piece) @ other, 0, atol=1e-14)


@pytest.mark.parametrize("form", Form)
def test_picking_agrees_with_the_polygon_that_is_drawn(form):
    sharpness = (6.0, 6.0) if form is Form.SG else (15.0, 3.0)
    lobe = lobes_of([sharpness], facing((0.9, 0.1, 0.2)), form)
    uv = np.random.default_rng(0).uniform([0, 0.2], [1, 0.8], (400, 2))
    polygons = [Polygon(curve) for curve in outlines(lobe)[0].curves]
    drawn = np.any([polygon.contains_points(uv) for polygon in polygons], axis=0)
    level = asg.evaluate(lobe, directions(uv))[:, 0].numpy()
    sure = np.abs(level - 0.5) > 0.01  # beyond a chord's distance from the curve
    picked = np.array([pick(lobe, d.tolist(), tolerance=0.0) == 0 for d in directions(uv)])
    np.testing.assert_array_equal(picked[sure], drawn[sure])
    assert 10 < drawn.sum() < 350


def test_the_smallest_outline_is_picked_then_the_nearest_centre():
    towards = [(0.0, 0.0, 1.0), (0.1, 0.0, 1.0), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0)]
    lobes = lobes_of([(1.0, 1.0), (30.0, 30.0), (1e6, 1e6), (1e6, 1e6)], facing(*towards))
    assert pick(lobes, (0.1, 0.0, 1.0), 0.01) == 1
    assert pick(lobes, (-0.4, 0.0, 1.0), 0.01) == 0
    assert pick(lobes, (0.0, 9.0, 0.03), 0.01) == 2
    assert pick(lobes, (0.0, 1.0, 0.03), 0.001) is None
    assert pick(lobes, (0.0, 0.0, -1.0), 0.01) is None


def test_a_sun_can_be_picked_out_of_its_sky():
    towards = [(0.0, 0.0, 1.0), (0.0, 0.1, 1.0), (0.0, 0.13, 1.0)]
    lobes = lobes_of([(2.0, 2.0), (1e6, 1e6), (1e6, 1e6)], facing(*towards))
    assert pick(lobes, (0.0, 0.11, 1.0), 0.05) == 1
    assert pick(lobes, (0.0, 0.12, 1.0), 0.05) == 2
    assert pick(lobes, (0.0, 0.3, 1.0), 0.05) == 0


def test_both_sides_of_a_bingham_lobe_and_the_drawn_side_of_a_wide_sg_are_picked():
    sun = lobes_of([(1e6, 1e6)], facing((0.0, 1.0, 0.0)), Form.BINGHAM)
    assert pick(sun, (0.0, -1.0, 0.02), 0.05) == 0
    wide = lobes_of([(0.1, 0.1)], facing((0.0, 1.0, 0.0)), Form.SG)
    assert pick(wide, (1.0, 0.1, 0.0), 0.0) == 0
    assert pick(wide, (1.0, -0.1, 0.0), 0.0) is None


@pytest.mark.parametrize("form", Form)
def test_contributions_sum_to_the_radiance(form):
    lobes = lobes_of([(4.0, 4.0), (0.5, 0.5), (9.0, 9.0)], form=form, amplitude=3.0)
    each = contributions(lobes, (0.2, -0.4, 1.0))
    direction = torch.tensor([[0.2, -0.4, 1.0]], dtype=torch.float64)
    direction /= direction.norm()
    torch.testing.assert_close(each.sum(0), asg.evaluate(lobes, direction)[0])
    assert each.shape == (3, 3)


def test_lobes_are_ranked_by_luminance_and_equals_keep_their_order():
    radiance = torch.tensor([[1.0, 0, 0], [0, 1, 0], [0, 0, 1], [1, 0, 0], [1, 1, 1]])
    assert brightest_first(radiance) == [4, 1, 0, 3, 2]
    np.testing.assert_allclose(luminance(radiance), [0.2126, 0.7152, 0.0722, 0.2126, 1], rtol=1e-6)


def test_energies_are_the_radiance_of_all_channels_summed_over_a_map():
    lobes = lobes_of([(4.0, 2.0), (20.0, 1.0)])
    lobes.amplitude[:] = torch.tensor([[1.0, 2.0, 3.0], [0.5, 0.0, 8.0]])
    grid = latlong.directions(256, 512, dtype=torch.float64).reshape(-1, 3)
    area = latlong.texel_solid_angles(256, 512, dtype=torch.float64).reshape(-1)
    wanted = [
        float((area @ asg.evaluate(lobes.select(torch.tensor([i])), grid)).sum()) for i in (0, 1)
    ]
    # the midpoint rule on 256 rows
    np.testing.assert_allclose(energies(lobes), wanted, rtol=1e-4)
