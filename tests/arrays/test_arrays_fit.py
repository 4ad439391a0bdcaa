# SPDX-License-Identifier: Apache-2.0
"""Fits of arrays: to the bit what the same frames in files come to."""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sky_files
import torch

import asglight
from asglight.arrays.radiance import prepared
from asglight.errors import InputError
from asglight.fitting.loss import objective, probes
from asglight.images import read_latlong
from asglight.lobes import LobeTracks
from asglight.shots.events import Event, FrameDone

FRAMES = range(1001, 1006)
NOT_OF_FILES = ("source", "image", "missing", "layer", "eye", "input_colorspace")


def frames() -> np.ndarray:
    """Return a sky whose third frame rests.  [5, 16, 32, 3]."""
    return np.stack([sky_files.sky(1003 if one == 1004 else one, 16) for one in FRAMES])


def written(folder: Path, values: np.ndarray) -> Path:
    folder.mkdir()
    for number, frame in zip(FRAMES, values, strict=True):
        sky_files.write_frame(folder / f"sky.{number}.exr", frame)
    return folder


def assert_same(found: LobeTracks, wanted: LobeTracks) -> None:
    assert (found.frames, found.fps, found.names) == (wanted.frames, wanted.fps, wanted.names)
    for name in ("axes", "sharpness", "amplitude"):
        assert torch.equal(getattr(found.lobes, name), getattr(wanted.lobes, name)), name
    kept = wanted.metadata.keys() - set(NOT_OF_FILES)
    assert {key: found.metadata[key] for key in kept} == {key: wanted.metadata[key] for key in kept}


@pytest.mark.parametrize("preset", ["live", "fast"])
def test_an_array_is_fitted_as_its_frames_in_files_are(preset: str, tmp_path: Path) -> None:
    values = frames()
    values[1, 2, 3] = np.nan
    values[0, 5, 5, 1] = -1e-4
    values[4, 8, 8] = np.inf
    before = values.copy()
    wanted = asglight.fit_sequence(written(tmp_path / "in", values), lobes=3, preset=preset)
    options = {"lobes": 3, "preset": preset, "first_frame": 1001}
    found = asglight.fit(values, **options)
    assert_same(found, wanted)
    assert found.metadata["source"] == "array"
    assert found.metadata["left_out"]["repeated_frames"] == [1004]
    assert found.metadata["repairs"]["infinite_texels"] == 1
    np.testing.assert_array_equal(values, before)
    assert_same(asglight.fit(torch.from_numpy(values), **options), wanted)


def test_one_frame_is_a_still(tmp_path: Path) -> None:
    frame = sky_files.sky(1001, 16)
    sky_files.write_frame(tmp_path / "sky.exr", frame)
    wanted = asglight.fit_sequence(tmp_path / "sky.exr", lobes=2)
    found = asglight.fit(frame, lobes=2)
    assert found.frames == (1,)
    assert torch.equal(found.lobes.amplitude, wanted.lobes.amplitude)
    asglight.write_usd(found, tmp_path / "sky.usda")
    assert asglight.read_usd(tmp_path / "sky.usda").metadata == found.metadata


def test_a_large_map_is_reduced_as_a_file_is(tmp_path: Path) -> None:
    values = np.random.default_rng(1).lognormal(sigma=2, size=(384, 768, 3)).astype(np.float32)
    path = sky_files.write_frame(tmp_path / "noise.exr", values)
    wanted = read_latlong(path, height=256).radiance
    for given in (values, torch.from_numpy(values), values.astype(np.float64)):
        found = prepared(given).radiance
        assert found.shape == (256, 512, 3)
        np.testing.assert_allclose(found, wanted, rtol=2e-5)  # float32 sums of nine texels


def test_any_layout_and_float_is_taken() -> None:
    values = frames()[0]
    turned = torch.from_numpy(np.moveaxis(values, -1, 0).copy()).permute(1, 2, 0)
    assert torch.equal(prepared(turned).radiance, prepared(values).radiance)
    half = values.astype(np.float16)
    np.testing.assert_array_equal(prepared(half).radiance, half.astype(np.float32))
    brain = torch.from_numpy(values).bfloat16().requires_grad_()
    np.testing.assert_array_equal(prepared(brain).radiance, brain.detach().float())


@pytest.mark.parametrize(
    ("values", "options", "message"),
    [
        (np.ones((4, 4, 3), np.float32), {}, r"radiance: shape \[4, 4, 3\]; expected \[H, 2 H, 3"),
        (np.ones((4, 8), np.float32), {}, r"radiance: shape \[4, 8\]; expected"),
        (np.ones((0, 4, 8, 3), np.float32), {}, r"radiance: shape \[0, 4, 8, 3\]; expected"),
        (np.ones((4, 8, 3), np.uint8), {}, "radiance: of type uint8; expected linear radiance in"),
        (torch.ones(4, 8, 3, dtype=torch.int16), {}, "radiance: of type torch.int16; expected"),
        ([np.ones((4, 8, 3)), np.ones((2, 4, 3))], {}, r"radiance: no array \(setting an array el"),
        (np.full((4, 8, 3), np.nan, np.float32), {}, "frame 1: holds nothing but NaN; expected"),
        (np.full((4, 8, 3), 1e37, np.float32), {}, r"frame 1: has a radiance of 1e\+37; expected"),
        (np.ones((4, 8, 3), np.float32), {"lobes": 0}, "lobes: 0"),
        (np.ones((4, 8, 3), np.float32), {"preset": "slow"}, "preset: slow; expected one of live"),
        (np.ones((4, 8, 3), np.float32), {"form": "cube"}, "form: cube; expected one of auto"),
        (np.ones((4, 8, 3), np.float32), {"fps": 0}, "fps: 0; expected a number above 0"),
        (np.ones((4, 8, 3), np.float32), {"repair": 2}, "repair: 2; expected a share from 0 to 1"),
    ],
)
def test_what_cannot_be_fitted_is_one_line(values, options: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        asglight.fit(values, **options)


def test_a_frame_that_lost_too_much_is_named() -> None:
    values = frames()
    values[2, :8] = np.nan
    with pytest.raises(InputError, match="frame 1003: has NaN or infinite values in 50 % of its"):
        asglight.fit(values, lobes=2, first_frame=1001)
    tracks = asglight.fit(values, lobes=2, first_frame=1001, repair=0.6)
    assert tracks.metadata["repairs"]["frames"] == [1003]


@pytest.mark.gpu
def test_a_tensor_on_a_gpu_is_fitted_there() -> None:
    if not torch.cuda.is_available():
        pytest.skip("needs a CUDA device")
    found = asglight.fit(torch.from_numpy(frames()[0]).cuda(), lobes=2)
    assert found.metadata["device"].startswith("cuda")
    assert found.lobes.axes.device.type == "cpu"


def test_frames_that_repeat_frame_0_say_so() -> None:
    events: list[Event] = []
    radiance = np.stack([sky_files.sky(1001, 16)] * 3)
    asglight.fit(radiance, lobes=2, preset="live", first_frame=0, on_progress=events.append)
    assert [one.repeats for one in events if isinstance(one, FrameDone)] == [None, 0, 0]


def test_bytes_may_be_in_any_order() -> None:
    radiance = sky_files.sky(1001, 16)
    found, wanted = (
        asglight.fit(one, lobes=2, preset="live") for one in (radiance.astype(">f4"), radiance)
    )
    assert_same(found, wanted)


@pytest.mark.parametrize("form", ["asg", "sg", "flat"])
def test_a_fit_is_the_same_whatever_type_torch_makes_by_default(form: str) -> None:
    shot = np.stack([sky_files.sky(n, 16) for n in (1, 2, 3)])
    wanted = asglight.fit(shot, lobes=2, form=form).lobes
    before = torch.get_default_dtype()
    for cached in (objective._probe_corners, probes._filter):  # what was made before stays right
        cached.cache_clear()
    torch.set_default_dtype(torch.float64)
    try:
        found = asglight.fit(shot, lobes=2, form=form).lobes
        asglight.plot(found[0])
    finally:
        torch.set_default_dtype(before)
    for name in ("axes", "sharpness", "amplitude"):
        assert torch.equal(getattr(found, name), getattr(wanted, name))


@pytest.mark.parametrize("name", ["fit", "follow"])
def test_what_is_masked_or_sparse_is_refused(name: str) -> None:
    sky = np.full((4, 8, 3), 0.5, np.float32)
    masked = np.ma.masked_array(sky, sky > 1)
    follower = asglight.Follower(1)
    take = follower.follow if name == "follow" else partial(asglight.fit, lobes=1)
    take(masked)  # nothing of it is
    masked[1, 2] = np.ma.masked
    for given in (masked, [masked]):
        with pytest.raises(InputError, match=r"^radiance: 3 values are masked; expected none\."):
            take(given)
    with pytest.raises(InputError, match=r"^radiance: a sparse tensor; expected a dense one\."):
        take(torch.from_numpy(sky).to_sparse())


SETTINGS = {
    "lobes": (2.5, True, "2", np.array(2)),
    "seed": (2.5, True, "2", None),
    "first_frame": (2.5, True, "2", None),
    "fps": (True, "24", None),
    "repair": (True, "0.1", None),
}


@pytest.mark.parametrize("name", SETTINGS)
def test_a_setting_that_is_no_number_is_refused(name: str) -> None:
    sky = np.full((4, 8, 3), 0.5, np.float32)
    for value in SETTINGS[name]:
        settings: dict[str, Any] = {name: value}
        with pytest.raises(InputError, match=f"^{name.replace('_', ' ')}: .*; expected a .*numb"):
            asglight.fit(sky, **settings)


def test_numbers_of_numpy_are_numbers(tmp_path: Path) -> None:
    sky = np.full((4, 8, 3), 0.5, np.float32)
    settings: dict[str, Any] = {"lobes": np.int64(2), "seed": np.uint8(3), "fps": np.float32(25)}
    settings |= {"first_frame": np.int16(7), "repair": np.float32(0.25)}
    found = asglight.fit(sky, **settings)
    asglight.write_usd(found, tmp_path / "sky.usda")
    again = asglight.read_usd(tmp_path / "sky.usda")
    assert (again.frames, again.fps) == ((7,), 25)
