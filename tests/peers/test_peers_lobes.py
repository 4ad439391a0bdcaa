# SPDX-License-Identifier: Apache-2.0
"""Peers that are sums of lobes: amplitudes against scipy, recovery of known lobes, Adam's step."""

import math

import numpy as np
import pytest
import scipy.optimize
import torch

from asglight.lobes import Form, Lobes, asg
from asglight.lobes.frames import axes_around
from asglight.peers import adam_sg, amplitudes, fixed_axes, l2_lobes, pursuit
from asglight.sphere import latlong
from asglight.sphere.quadrature import fibonacci_directions


def lobes(
    axes: list[list[float]], sharpness: list[float], light: list[list[float]], form: Form
) -> Lobes:
    axis_z = torch.nn.functional.normalize(torch.tensor(axes), dim=-1)
    pairs = torch.tensor(sharpness).reshape(len(axes), -1).expand(-1, 2).contiguous()
    return Lobes(axes_around(axis_z), pairs, torch.tensor(light), form)


def image(truth: Lobes, height: int = 24) -> torch.Tensor:
    directions = latlong.directions(height, 2 * height).reshape(-1, 3)
    return asg.evaluate(truth, directions).reshape(height, 2 * height, 3)


def random_problem(seed: int) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(seed)
    values = torch.rand(5, 40, generator=generator, dtype=torch.float64)
    weight = torch.rand(40, generator=generator, dtype=torch.float64)
    radiance = torch.randn(40, 3, generator=generator, dtype=torch.float64)
    return values, weight, radiance


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("signed", [True, False])
def test_amplitudes_are_those_of_scipys_bounded_least_squares(seed: int, signed: bool) -> None:
    values, weight, radiance = random_problem(seed)
    found = amplitudes.solve(values, values * weight, radiance, signed=signed).numpy()
    root = weight.sqrt().numpy()
    bounds = (-np.inf if signed else 0.0, np.inf)
    for channel in range(3):
        expected = scipy.optimize.lsq_linear(
            values.numpy().T * root[:, None], radiance[:, channel].numpy() * root, bounds, tol=1e-14
        )
        # the interior-point solver stops 1e-6 from a bound; the ridge is 1e-9
        np.testing.assert_allclose(found[:, channel], expected.x, atol=1e-5)
    assert signed or found.min() == 0, "some amplitude of random values is held at 0"


def test_two_equal_lobes_share_their_light() -> None:
    values, weight, radiance = random_problem(4)
    twice = torch.cat([values, values[:1]])
    found = amplitudes.solve(twice, twice * weight, radiance, signed=True)
    once = amplitudes.solve(values, values * weight, radiance, signed=True)
    torch.testing.assert_close(found[0] + found[-1], once[0], rtol=1e-4, atol=1e-5)
    assert float((found[0] - found[-1]).abs().max()) < 1e-3 * float(once[0].abs().max())


def test_fixed_axes_recover_amplitudes_of_their_own_lobes() -> None:
    count = 12
    axis_z = fibonacci_directions(count)
    light = torch.rand(count, 3, generator=torch.Generator().manual_seed(5))
    s = fixed_axes.sharpness(axis_z)
    truth = Lobes(axes_around(axis_z), torch.full((count, 2), s), light, Form.SG)
    found = fixed_axes.fit(image(truth), 3 * count + 2)
    assert found.floats == 3 * count
    torch.testing.assert_close(found.lobes.amplitude, light, rtol=1e-4, atol=1e-4)


def test_the_common_sharpness_falls_as_its_definition_says() -> None:
    axis_z = fibonacci_directions(20, dtype=torch.float64).numpy()
    half = [(a + axis_z[0]) / np.linalg.norm(a + axis_z[0]) for a in axis_z[1:]]
    lowest = min(float(h @ axis_z[0]) for h in half)
    found = fixed_axes.sharpness(torch.from_numpy(axis_z))
    # 1e-4 of the constant in its divisor, over 1 - lowest of about 0.9
    assert math.exp(found * (lowest - 1)) == pytest.approx(0.65**20, rel=5e-3)


def test_adam_first_moves_every_parameter_by_the_learning_rate_downhill() -> None:
    """Adam's first step is the learning rate times the sign of the slope, taken by differences."""
    reference = torch.rand(8, 16, 3, generator=torch.Generator().manual_seed(6)).double().numpy()
    start = torch.randn(2, 7, generator=torch.Generator().manual_seed(0)).double().numpy()
    start[:, 3] *= 100
    directions = latlong.directions(8, 16, dtype=torch.float64).numpy()

    def error(raw: np.ndarray) -> float:
        axis = raw[:, :3] / np.linalg.norm(raw[:, :3], axis=1, keepdims=True)
        values = np.exp(np.abs(raw[:, 3]) * (directions @ axis.T - 1))
        return float(((values @ np.abs(raw[:, 4:]) - reference) ** 2).mean())

    expected = start.copy()
    for place in np.ndindex(*start.shape):
        step = np.zeros_like(start)
        step[place] = 1e-5
        expected[place] -= 0.01 * np.sign(error(start + step) - error(start - step))
    found = adam_sg.fit(torch.from_numpy(reference).float(), 13, steps=1).lobes
    assert found.count == 2
    np.testing.assert_allclose(found.sharpness[:, 0].numpy(), np.abs(expected[:, 3]), rtol=1e-5)
    np.testing.assert_allclose(found.amplitude.numpy(), np.abs(expected[:, 4:]), atol=1e-5)
    axis = expected[:, :3] / np.linalg.norm(expected[:, :3], axis=1, keepdims=True)
    np.testing.assert_allclose(found.axis_z.numpy(), axis, atol=1e-5)


def test_adam_reports_its_steps_and_lowers_the_error() -> None:
    reference = image(lobes([[1, 0.2, 0.3]], [6.0], [[2.0, 1.0, 0.5]], Form.SG), 16)
    steps: list[int] = []
    errors = [
        float((adam_sg.fit(reference, 18, steps=k, on_step=steps.append).texel_means(16, 32)
               - reference).square().mean())
        for k in (1, 300)
    ]  # fmt: skip
    assert steps == [1, *range(1, 301)]
    assert errors[1] < 0.8 * errors[0]


def test_pursuit_starts_at_the_lamps() -> None:
    truth = lobes([[0, 0.3, 1], [1, -0.2, 0]], [50.0, 8.0], [[9.0] * 3, [1.0] * 3], Form.SG)
    found = pursuit.start(image(truth), 2, signed=False)
    cosines = (found.axis_z @ truth.axis_z.mT).amax(0)
    # axes lie on a grid of 5.6 degrees; a wide lobe may be helped by one beside it
    assert float(cosines.min()) > math.cos(math.radians(8))


@pytest.mark.parametrize("factor", [2.0**124, 2.0**-100])
def test_pursuit_starts_at_the_same_lamps_however_bright(factor: float) -> None:
    truth = lobes([[0, 0.3, 1], [1, -0.2, 0]], [50.0, 8.0], [[9.0] * 3, [1.0] * 3], Form.SG)
    wanted = pursuit.start(image(truth), 4, signed=False)
    found = pursuit.start(factor * image(truth), 4, signed=False)
    assert torch.equal(found.axes, wanted.axes)
    assert torch.equal(found.sharpness, wanted.sharpness)


def test_scattered_srbf_recovers_lobes_of_either_sign() -> None:
    truth = lobes(
        [[0, 0.3, 1], [1, -0.2, 0]], [40.0, 6.0], [[3.0, 2.0, 1.0], [-1.0, -0.5, -2.0]], Form.SG
    )
    found = l2_lobes.scattered_srbf(image(truth), 14, iterations=(60, 20))
    assert found.floats == 12
    order = (found.lobes.axis_z @ truth.axis_z.mT).argmax(0)
    # what is left of the error is float32's rounding of the map
    torch.testing.assert_close(found.lobes.axis_z[order], truth.axis_z, rtol=0, atol=1e-3)
    torch.testing.assert_close(found.lobes.sharpness[order], truth.sharpness, rtol=1e-2, atol=0)
    torch.testing.assert_close(found.lobes.amplitude[order], truth.amplitude, rtol=1e-2, atol=0)


def test_amplitudes_of_either_sign_come_no_further_off_than_those_of_one() -> None:
    directions = latlong.directions(64, 128, dtype=torch.float64)
    radiance = (0.5 + 0.4 * directions[..., 1:2]).expand(-1, -1, 3).clone()
    radiance[18:20, 42:44] = 20_000.0  # a sun
    solid_angle = latlong.texel_solid_angles(64, 128, dtype=torch.float64)[..., None]

    def squared_error(found: Lobes) -> float:
        shown = asg.evaluate(found.to(torch.float64), directions.reshape(-1, 3))
        return float((solid_angle * (shown.reshape(64, 128, 3) - radiance).square()).sum())

    either = squared_error(l2_lobes.scattered_srbf(radiance.float(), 48).lobes)
    one = squared_error(l2_lobes.least_squares(radiance.float(), 48, Form.SG).lobes)
    assert either <= 1.01 * one  # lobes are rounded to float32


def test_least_squares_recovers_an_anisotropic_lobe() -> None:
    truth = Lobes(
        axes_around(torch.nn.functional.normalize(torch.tensor([[0.5, 0.4, -1.0]]), dim=-1)),
        torch.tensor([[30.0, 4.0]]),
        torch.tensor([[1.0, 2.0, 3.0]]),
    )
    found = l2_lobes.least_squares(image(truth), 8, Form.ASG, iterations=(80, 20)).lobes
    torch.testing.assert_close(found.axis_z, truth.axis_z, rtol=0, atol=1e-3)
    torch.testing.assert_close(found.amplitude, truth.amplitude, rtol=1e-2, atol=0)
    swap = float(found.sharpness[0, 0]) < float(found.sharpness[0, 1])
    torch.testing.assert_close(
        found.sharpness.flip(-1) if swap else found.sharpness, truth.sharpness, rtol=1e-2, atol=0
    )


def test_least_squares_has_no_negative_light_and_keeps_its_budget() -> None:
    truth = lobes([[0, 1, 0], [0, -1, 0.1]], [5.0, 9.0], [[1.0] * 3, [-0.5] * 3], Form.SG)
    found = l2_lobes.least_squares(image(truth, 16).clamp(min=0), 20, Form.SG, iterations=(20, 5))
    assert found.floats == 18
    assert float(found.lobes.amplitude.min()) >= 0


def test_no_lobe_hides_between_texels() -> None:
    """A lamp of one texel asks for an ever narrower lobe; one that covers a texel is the end."""
    reference = torch.full((16, 32, 3), 0.01)
    reference[5, 9] = 1000.0
    found = l2_lobes.least_squares(reference, 6, Form.SG, iterations=(40, 40)).lobes
    assert float(found.sharpness.max()) <= 2 * math.pi / (math.pi / 16) ** 2 * (1 + 1e-5)
    flux = float(asg.flux(found).sum())
    solid_angle = latlong.texel_solid_angles(16, 32)[..., None]
    # 28 degrees up, the texel is 12 % smaller than that of the equator
    assert flux == pytest.approx(float((solid_angle * reference).sum()), rel=0.2)
