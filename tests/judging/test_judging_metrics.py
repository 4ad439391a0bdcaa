# SPDX-License-Identifier: Apache-2.0
"""Every metric against its written definition, re-done in plain numpy in float64."""

import math

import numpy as np
import pytest
import torch

from asglight.judging import metrics
from asglight.lobes import Form, Lobes, texels

HEIGHT, WIDTH = 16, 32

SINGLE = 2e-5
"""Relative. Filtering runs in the dtype of the maps, float32: sums of 512 products."""


def _grid() -> tuple[np.ndarray, np.ndarray]:
    """Return texel directions [H W, 3] and solid angles [H W]."""
    v, u = np.meshgrid(
        (np.arange(HEIGHT) + 0.5) / HEIGHT, (np.arange(WIDTH) + 0.5) / WIDTH, indexing="ij"
    )
    longitude, latitude = np.pi - 2 * np.pi * u, np.pi / 2 - np.pi * v
    across = np.cos(latitude)
    d = np.stack([across * np.sin(longitude), np.sin(latitude), across * np.cos(longitude)], -1)
    top, bottom = (np.pi / 2 - np.pi * (np.arange(HEIGHT) + k) / HEIGHT for k in (0, 1))
    band = 2 * np.pi / WIDTH * (np.sin(top) - np.sin(bottom))
    return d.reshape(-1, 3), np.repeat(band, WIDTH)


def _fibonacci(count: int) -> np.ndarray:
    golden_angle = np.pi * (3 - np.sqrt(5))
    i = np.arange(count)
    y = 1 - 2 * (i + 0.5) / count
    r = np.sqrt(1 - y**2)
    return np.stack([r * np.cos(golden_angle * i), y, r * np.sin(golden_angle * i)], axis=1)


def _filter(image: np.ndarray, kernel: float | None) -> np.ndarray:
    """Return irradiance over pi (no kernel) or GGX-filtered radiance at 768 directions."""
    texels, solid_angle = _grid()
    c = _fibonacci(768) @ texels.T
    if kernel is None:
        weight = np.maximum(c, 0) / np.pi * solid_angle
    else:
        alpha = kernel**2
        weight = np.maximum(c, 0) / (((1 + c) / 2) * (alpha**2 - 1) + 1) ** 2 * solid_angle
        weight /= weight.sum(axis=1, keepdims=True)
    return weight @ image.reshape(-1, 3)


def _expected(fit: np.ndarray, reference: np.ndarray) -> dict[str, float]:
    _, solid_angle = _grid()
    omega = solid_angle.reshape(HEIGHT, WIDTH, 1)
    e_fit, e_ref = _filter(fit, None), _filter(reference, None)
    result = {
        "env": (omega * np.abs(fit - reference)).sum() / (omega * reference).sum(),
        "flux": abs((omega * fit).sum() / (omega * reference).sum() - 1),
        "irr": np.abs(e_fit - e_ref).sum() / e_ref.sum(),
        "irrMax": np.abs(e_fit - e_ref).max() / e_ref.mean(),
    }
    for name, roughness in (("r0.5", 0.5), ("r0.25", 0.25)):
        l_fit, l_ref = _filter(fit, roughness), _filter(reference, roughness)
        result[name] = np.abs(l_fit - l_ref).sum() / l_ref.sum()
    return {name: float(value) for name, value in result.items()}


def _maps(count: int, seed: int) -> list[np.ndarray]:
    rng = np.random.default_rng(seed)
    shape = (HEIGHT, WIDTH, 3)
    return [rng.lognormal(sigma=1.5, size=shape).astype(np.float32) for _ in range(count)]


def _judge(fit: np.ndarray, reference: np.ndarray) -> metrics.FrameErrors:
    return metrics.map_errors(torch.from_numpy(fit), torch.from_numpy(reference))


@pytest.mark.parametrize("seed", range(3))
def test_metrics_of_a_frame_are_their_definitions(seed: int) -> None:
    fit, reference = _maps(2, seed)
    found = _judge(fit, reference).values
    expected = _expected(fit.astype(np.float64), reference.astype(np.float64))
    assert tuple(found) == metrics.METRIC_NAMES
    assert found == pytest.approx(expected, rel=SINGLE)


def test_metrics_of_float64_maps_equal_their_definitions_to_rounding() -> None:
    fit, reference = (m.astype(np.float64) for m in _maps(2, 7))
    assert _judge(fit, reference).values == pytest.approx(_expected(fit, reference), rel=1e-11)


def test_a_tinted_fit_is_judged_by_the_sum_of_its_channels() -> None:
    (reference,) = _maps(1, 8)
    fit = reference * np.array([1.5, 1.0, 1.0], dtype=np.float32)
    found = _judge(fit, reference).values
    _, solid_angle = _grid()
    flux = (solid_angle[:, None] * reference.reshape(-1, 3)).sum(0)
    assert found["env"] == pytest.approx(0.5 * flux[0] / flux.sum(), rel=1e-5)
    assert found["flux"] == pytest.approx(0.5 * flux[0] / flux.sum(), rel=1e-5)


def test_a_constant_gain_shows_as_itself_in_every_sum() -> None:
    (reference,) = _maps(1, 9)
    found = _judge(reference * np.float32(1.25), reference).values
    for name in ("env", "flux", "irr", "r0.5", "r0.25"):
        assert found[name] == pytest.approx(0.25, rel=1e-5)


def test_a_perfect_fit_has_no_error() -> None:
    (reference,) = _maps(1, 10)
    found = _judge(reference, reference.copy()).values
    assert found["env"] == found["flux"] == 0
    # the filter sums fit and reference in one matrix product, whose order of summing may differ
    assert max(found.values()) < 2e-6


def test_a_black_reference_forgives_only_a_black_fit() -> None:
    black = np.zeros((HEIGHT, WIDTH, 3), dtype=np.float32)
    assert set(_judge(black, black).values.values()) == {0.0}
    (bright,) = _maps(1, 11)
    assert set(_judge(bright, black).values.values()) == {math.inf}


def test_a_black_fit_is_wrong_by_everything() -> None:
    (reference,) = _maps(1, 12)
    found = _judge(np.zeros_like(reference), reference).values
    for name in ("env", "flux", "irr", "r0.5", "r0.25"):
        assert found[name] == pytest.approx(1, rel=1e-6)


def _lobes(sharpness: float) -> Lobes:
    """Return one lobe that points well inside a texel, at u = 0.398, v = 0.705."""
    axes = torch.tensor([[[0.8, 0.0, -0.6], [0.36, 0.8, 0.48], [0.48, -0.6, 0.64]]])
    return Lobes(axes, torch.tensor([[sharpness, sharpness]]), torch.tensor([[1.0, 2.0, 3.0]]))


def test_lobes_are_judged_as_the_map_that_they_make() -> None:
    """A wide lobe in numpy, at texel centres; the metrics of that map against another."""
    texels, _ = _grid()
    lobes = _lobes(2.5)
    x, y, z = (texels @ axis.double().numpy() for axis in lobes.axes[0])
    unit = np.maximum(z, 0) * np.exp(-2.5 * (x**2 + y**2))
    fit = (unit[:, None] * np.array([1.0, 2.0, 3.0])).reshape(HEIGHT, WIDTH, 3)
    (reference,) = _maps(1, 13)
    found = metrics.frame_errors(lobes, torch.from_numpy(reference)).values
    # sigma is 0.447 and texels 0.196: narrower than four of them, so averaged, 2 % at the peak
    assert found == pytest.approx(_expected(fit, reference.astype(np.float64)), rel=2e-2)


@pytest.mark.parametrize("form", list(Form))
def test_energy_of_a_pinpoint_lobe_counts_in_full(form: Form) -> None:
    """A lobe of 0.04 degrees against one texel that holds the same energy."""
    s = 1e6
    lobes = Lobes(_lobes(s).axes, torch.full((1, 2), s), torch.full((1, 3), 1e5), form)
    texels, solid_angle = _grid()
    axis = lobes.axes[0, 2].double().numpy()
    integral = {Form.SG: 2 * math.pi / s, Form.FLAT: 11 / 6 * math.pi / s}.get(form, math.pi / s)
    reference = np.zeros((HEIGHT * WIDTH, 3))
    nearest = [int(np.argmax(texels @ axis))]
    if form is Form.BINGHAM:
        nearest.append(int(np.argmin(texels @ axis)))
    for texel in nearest:
        reference[texel] = 1e5 * integral / solid_angle[texel]
    image = torch.from_numpy(reference.reshape(HEIGHT, WIDTH, 3)).float()
    found = metrics.frame_errors(lobes, image).values
    # four nodes a panel of two sigmas hold the mean to 6e-8 2^8 an axis
    assert found["flux"] < 4e-5
    assert found["env"] < 4e-5


def _sequence(seed: int, frames: int = 4) -> tuple[list[np.ndarray], list[np.ndarray]]:
    return _maps(frames, seed), _maps(frames, seed + 100)


def test_flicker_is_its_definition() -> None:
    fits, references = _sequence(20)
    judged = [
        (1001 + i, _judge(*pair)) for i, pair in enumerate(zip(fits, references, strict=True))
    ]
    found = metrics.sequence_errors(judged)
    l_fit = np.stack([_filter(m.astype(np.float64), 0.25) for m in fits])
    l_ref = np.stack([_filter(m.astype(np.float64), 0.25) for m in references])
    change = np.abs((l_fit[1:] - l_fit[:-1]) - (l_ref[1:] - l_ref[:-1])).sum()
    assert found.mean["flicker"] == pytest.approx(change / l_ref.sum(), rel=SINGLE)


def test_an_error_that_stays_is_not_flicker() -> None:
    _, references = _sequence(21)
    offset = np.float32(0.75)
    judged = [(i, _judge(r + offset, r)) for i, r in enumerate(references)]
    found = metrics.sequence_errors(judged)
    assert found.mean["r0.25"] > 0.1
    assert found.mean["flicker"] < 1e-6, "float32 rounding of the offset"


def test_a_sequence_has_the_mean_and_the_worst_frame_of_each_metric() -> None:
    fits, references = _sequence(22)
    judged = {7 * i: _judge(f, r) for i, (f, r) in enumerate(zip(fits, references, strict=True))}
    found = metrics.sequence_errors(iter(judged.items()))
    assert list(found.frames) == [0, 7, 14, 21]
    for name in metrics.METRIC_NAMES:
        column = {frame: errors.values[name] for frame, errors in judged.items()}
        assert found.mean[name] == pytest.approx(np.mean(list(column.values())), rel=1e-14)
        assert column[found.worst[name]] == max(column.values())
    assert set(found.worst) == set(metrics.METRIC_NAMES), "flicker has no frame"


def test_one_frame_has_no_flicker() -> None:
    fit, reference = _maps(2, 23)
    found = metrics.sequence_errors([(1, _judge(fit, reference))])
    assert "flicker" not in found.mean
    assert found.mean == found.frames[1]


def test_flicker_of_a_black_sequence_is_nothing_or_infinite() -> None:
    black = np.zeros((HEIGHT, WIDTH, 3), dtype=np.float32)
    steady = metrics.sequence_errors([(i, _judge(black, black)) for i in (1, 2)])
    assert steady.mean["flicker"] == 0
    fits = _maps(2, 24)
    moving = metrics.sequence_errors([(i, _judge(fit, black)) for i, fit in enumerate(fits)])
    assert moving.mean["flicker"] == math.inf


def test_maps_judged_together_get_the_errors_that_each_gets_alone() -> None:
    torch.manual_seed(3)
    reference = torch.rand(8, 16, 3, dtype=torch.float64)
    fits = torch.rand(3, 8, 16, 3, dtype=torch.float64)
    together = metrics.maps_errors(fits, reference)
    for fit, found in zip(fits, together, strict=True):
        alone = metrics.map_errors(fit, reference)
        # sums of a wider matrix product may run in another order
        assert found.values == pytest.approx(alone.values, rel=1e-12)
        torch.testing.assert_close(found.fit_filtered, alone.fit_filtered)


def test_frames_judged_together_get_the_errors_that_each_gets_alone() -> None:
    torch.manual_seed(4)
    scale = torch.tensor([1.0, 1e-3, 0.0, 1e6], dtype=torch.float64)[:, None, None, None]
    references = scale * torch.rand(4, 8, 16, 3, dtype=torch.float64)  # one of them is black
    fits = scale * torch.rand(4, 8, 16, 3, dtype=torch.float64)
    together = metrics.frames_errors(list(fits), list(references))
    for fit, reference, found in zip(fits, references, together, strict=True):
        alone = metrics.map_errors(fit, reference)
        assert found.values == pytest.approx(alone.values, rel=1e-12)
        torch.testing.assert_close(found.fit_filtered, alone.fit_filtered)
        torch.testing.assert_close(found.reference_filtered, alone.reference_filtered)


def test_irradiance_errors_are_irr_of_each_frame_on_a_map_of_the_lobes() -> None:
    generator = torch.Generator().manual_seed(1)
    count = metrics.FRAMES_AT_ONCE + 2  # more than one piece
    shots = [
        Lobes(
            torch.eye(3).expand(count, 2, 3, 3),
            10 ** torch.rand(count, 2, 2, generator=generator),
            torch.rand(count, 2, 3, generator=generator),
            Form.ASG,
        )
        for _ in range(2)
    ]
    found = metrics.irradiance_errors(*shots)
    assert len(found) == count
    for index in (0, count - 1):
        lobes, reference = (shot[index] for shot in shots)
        maps = texels.texel_means(reference, metrics.LOBE_ROWS, 2 * metrics.LOBE_ROWS)
        expected = metrics.frame_errors(lobes, maps).values["irr"]
        assert found[index] == pytest.approx(expected, rel=1e-5)  # sums in another order


@pytest.mark.parametrize("factor", [2.0**119, 2.0**-100])
def test_errors_do_not_depend_on_the_exposure(factor: float) -> None:
    """GGX kernels of up to 65,000 times a map of up to 6e36 would leave float32."""
    fit, reference = (m * np.float32(factor) for m in _maps(2, 5))
    expected = _expected(fit.astype(np.float64), reference.astype(np.float64))
    assert _judge(fit, reference).values == pytest.approx(expected, rel=SINGLE)


@pytest.mark.parametrize("rows", [1, 2, 5, 8])
def test_a_map_of_few_rows_is_judged_as_constant_within_its_texels(rows: int) -> None:
    coarse = np.random.default_rng(rows).random((rows, 2 * rows, 3)).astype(np.float32)
    factor = -(-metrics.ROWS_MIN // rows)
    fine = coarse.repeat(factor, 0).repeat(factor, 1)
    fit = texels.texel_means(_lobes(5.0), *fine.shape[:2])
    found = metrics.irradiance_error(_lobes(5.0), torch.from_numpy(coarse))
    assert found == pytest.approx(_judge(fit.numpy(), fine).values["irr"], rel=SINGLE)


def test_the_irradiance_error_alone_is_that_among_the_others() -> None:
    reference = torch.rand(48, 96, 3, generator=torch.Generator().manual_seed(1))
    found = metrics.irradiance_error(_lobes(5.0), reference)
    every = metrics.frame_errors(_lobes(5.0), reference).values
    assert found == pytest.approx(every["irr"], rel=SINGLE)


def test_a_frame_is_judged_on_one_thread_and_others_have_theirs_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    seen: list[int] = []

    def texel_means(*arguments: object) -> torch.Tensor:
        seen.append(torch.get_num_threads())
        return torch.ones(HEIGHT, WIDTH, 3)

    monkeypatch.setattr(texels, "texel_means", texel_means)
    lobes = Lobes(torch.eye(3)[None], torch.ones(1, 2), torch.ones(1, 3), Form.ASG)
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        metrics.frame_errors(lobes, torch.ones(HEIGHT, WIDTH, 3))
        after = torch.get_num_threads()
    finally:
        torch.set_num_threads(before)
    assert (seen, after) == ([1], 2)
