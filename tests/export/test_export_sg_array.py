# SPDX-License-Identifier: Apache-2.0
"""Arrays of PhySG and NeRD: what their own formulas show of them, bits there and back, faults."""

import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from usd_tracks import moving

from asglight.errors import InputError
from asglight.export import SgLayout, read_sg_array, write_sg_array
from asglight.lobes import Form, Lobes, LobeTracks, asg, texels

LAYOUTS = list(SgLayout)
ROWS = 128


def shown_by(layout: SgLayout, array: NDArray[np.float32]) -> NDArray[np.float64]:
    """Evaluate an array [N, 7] at the texel centres of a latlong as its program does.  [H, W, 3].

    The direction at (u, v) and the columns are those of the two sources that sg_array.py cites.
    """
    numbers = array.astype(np.float64)
    v, u = ((np.arange(n) + 0.5) / n for n in (ROWS, 2 * ROWS))
    polar, around = np.meshgrid(np.pi * v, 2 * np.pi * u, indexing="ij")
    if layout is SgLayout.PHYSG:
        turned = around - np.pi / 2
        d = [np.cos(turned) * np.sin(polar), np.cos(polar), np.sin(turned) * np.sin(polar)]
        axis, sharpness, amplitude = np.split(numbers, [3, 4], axis=-1)
        sharpness = np.abs(sharpness)
    else:
        d = [np.sin(polar) * np.sin(around), np.cos(polar), np.sin(polar) * np.cos(around)]
        amplitude, axis, sharpness = np.split(numbers, [3, 6], axis=-1)
        sharpness = np.clip(sharpness, 0.5, 30)
    axis /= np.linalg.norm(axis, axis=-1, keepdims=True)
    values = np.exp(sharpness[:, 0] * (np.stack(d, -1) @ axis.T - 1))
    return values @ np.abs(amplitude)


def texels_of(lobes: Lobes) -> NDArray[np.float64]:
    return texels.texel_means(lobes.to(torch.float64), ROWS, 2 * ROWS).numpy()


def soft(form: Form = Form.SG, frames: int = 3) -> LobeTracks:
    """Return lobes that both programs hold and that are sampled at the texel centres."""
    tracks = moving(range(1, frames + 1), lobes=5, form=form)
    tracks.lobes.sharpness[:] = tracks.lobes.sharpness.clamp(0.6, 29)
    return tracks


@pytest.mark.parametrize("layout", LAYOUTS)
def test_the_program_shows_the_texels_of_sg_lobes(tmp_path: Path, layout: SgLayout) -> None:
    tracks = soft()
    write_sg_array(tmp_path / "a.npy", tracks, layout)
    array = np.load(tmp_path / "a.npy")
    assert array.dtype == np.float32
    assert array.shape == (3, 5, 7)
    for frame in range(3):
        expected = texels_of(tracks.lobes[frame])
        # Axes that are float32 are unit to 1e-7, which 29 times their cosine shows.
        np.testing.assert_allclose(shown_by(layout, array[frame]), expected, rtol=1e-5)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_what_is_read_shows_the_texels_of_the_program(tmp_path: Path, layout: SgLayout) -> None:
    # As they are optimised: axes of any length, signs of any kind where the absolute value counts.
    random = np.random.default_rng(3)
    array = random.normal(size=(6, 7)).astype(np.float32)
    column = 3 if layout is SgLayout.PHYSG else 6
    array[:, column] = [0.2, 3.0, 9.0, 20.0, 45.0, 80.0]
    if layout is SgLayout.PHYSG:
        array[::2, 3] *= -1
    np.save(tmp_path / "a.npy", array)
    tracks = read_sg_array(tmp_path / "a.npy", layout, first_frame=1001, fps=25.0)
    assert (tracks.frames, tracks.fps, tracks.lobes.form) == ((1001,), 25.0, Form.SG)
    expected = shown_by(layout, array)
    np.testing.assert_allclose(texels_of(tracks.lobes[0]), expected, rtol=3e-5)  # as above, at 80


@pytest.mark.parametrize(
    ("layout", "expected"),
    [(SgLayout.PHYSG, [0, 1, 0, 8, 1, 2, 3]), (SgLayout.NERD, [1, 2, 3, 0, 1, 0, 8])],
)
def test_straight_up_is_plus_y_in_both(
    tmp_path: Path, layout: SgLayout, expected: list[float]
) -> None:
    axes = torch.tensor([[[[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]]])
    up = Lobes(axes, torch.full((1, 1, 2), 8.0), torch.tensor([[[1.0, 2.0, 3.0]]]), Form.SG)
    write_sg_array(tmp_path / "up.npy", LobeTracks((7,), 24.0, up), layout)
    assert np.load(tmp_path / "up.npy").tolist() == [expected]
    brightest = shown_by(layout, np.load(tmp_path / "up.npy")).sum(-1)
    assert np.unravel_index(brightest.argmax(), brightest.shape)[0] == 0  # in the top row


@pytest.mark.parametrize(
    ("layout", "direction"), [(SgLayout.PHYSG, [0, 0, 1]), (SgLayout.NERD, [0, 0, -1])]
)
def test_the_centre_of_the_map_is_where_the_program_has_it(
    tmp_path: Path, layout: SgLayout, direction: list[float]
) -> None:
    ahead = Lobes(
        torch.eye(3)[None, None], torch.full((1, 1, 2), 8.0), torch.ones(1, 1, 3), Form.SG
    )
    write_sg_array(tmp_path / "a.npy", LobeTracks((7,), 24.0, ahead), layout)
    array = np.load(tmp_path / "a.npy")[0]
    assert (array[:3] if layout is SgLayout.PHYSG else array[3:6]).tolist() == direction


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("frames", [1, 4])
def test_sg_lobes_come_back_to_the_bit(tmp_path: Path, layout: SgLayout, frames: int) -> None:
    tracks = soft(frames=frames)
    written = write_sg_array(tmp_path / "a.npy", tracks, layout)
    assert torch.equal(written.sharpness, tracks.lobes.sharpness)
    back = read_sg_array(tmp_path / "a.npy", layout)
    assert back.frames == tuple(range(1, frames + 1))
    assert torch.equal(back.lobes.axis_z, tracks.lobes.axis_z)
    assert torch.equal(back.lobes.sharpness, tracks.lobes.sharpness)
    assert torch.equal(back.lobes.amplitude, tracks.lobes.amplitude)
    write_sg_array(tmp_path / "b.npy", back, layout)
    assert (tmp_path / "a.npy").read_bytes() == (tmp_path / "b.npy").read_bytes()


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("form", [Form.ASG, Form.BINGHAM])
def test_the_flux_of_other_forms_is_kept(tmp_path: Path, layout: SgLayout, form: Form) -> None:
    tracks = moving([1], lobes=5, form=form)
    tracks.lobes.sharpness[:, 0] *= 1e4
    tracks.lobes.sharpness[:, 1] *= 1e-3
    write_sg_array(tmp_path / "a.npy", tracks, layout)
    array = np.load(tmp_path / "a.npy").astype(np.float64)
    sharpness, amplitude = (
        (array[:, 3:4], array[:, 4:]) if layout is SgLayout.PHYSG else (array[:, 6:], array[:, :3])
    )
    found = amplitude * 2 * np.pi * -np.expm1(-2 * sharpness) / sharpness
    found = found.reshape(-1, 5, 3).sum(0)  # the twins of bingham lobes with them
    expected = asg.flux(tracks.lobes[0].to(torch.float64))
    np.testing.assert_allclose(found, expected, rtol=1e-6)  # roundings to float32
    if layout is SgLayout.NERD:
        assert sharpness.min() >= 0.5
        assert sharpness.max() == 30


def test_frames_turn_no_more_than_their_axes(tmp_path: Path) -> None:
    random = np.random.default_rng(0)
    array = np.ones((40, 3, 7), np.float32)
    array[..., :3] = random.normal(size=3) + 0.05 * random.normal(size=(40, 3, 3)).cumsum(0)
    array[20:, 2, :3] *= -1  # a lobe that turns round at once
    np.save(tmp_path / "a.npy", array)
    axes = read_sg_array(tmp_path / "a.npy", SgLayout.PHYSG).lobes.axes.double()
    identity = torch.eye(3).double().expand(40, 3, 3, 3)
    torch.testing.assert_close(axes @ axes.mT, identity, rtol=0, atol=1e-6)  # float32
    assert bool((torch.linalg.det(axes) > 0).all())
    turn = (axes[1:, :2] * axes[:-1, :2]).sum((-1, -2)).sub(1).div(2).clamp(-1, 1).acos()
    moved = (axes[1:, :2, 2] * axes[:-1, :2, 2]).sum(-1).clamp(-1, 1).acos()
    assert float((turn - moved).abs().max()) < 1e-3  # acos of a cosine that is off by 1e-7


@pytest.mark.parametrize("kind", [np.float16, np.float64, ">f4"])
def test_other_floats_and_orders_are_read(tmp_path: Path, kind: str) -> None:
    array = np.arange(1, 29).reshape(4, 7)
    np.save(tmp_path / "a.npy", np.asfortranarray(array, kind))
    found = read_sg_array(tmp_path / "a.npy", SgLayout.PHYSG).lobes
    assert found.sharpness[0, :, 0].tolist() == [4, 11, 18, 25]
    assert found.amplitude[0, 3].tolist() == [26, 27, 28]


def test_a_sharpness_of_0_is_an_even_sphere(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.array([[0, 0, 2, 0, 5, 5, 5]], np.float32))
    found = read_sg_array(tmp_path / "a.npy", SgLayout.PHYSG)
    np.testing.assert_allclose(texels_of(found.lobes[0]), 5, rtol=2e-3)  # at the limit 1e-3


GOOD = np.ones((2, 3, 7), np.float32)


def with_value(value: float, column: int) -> NDArray[np.float32]:
    array = GOOD.copy()
    array[1, 2, column] = value
    return array


PLACE = r"a\.npy: row 2 of frame 1, counted from 0, has "
FAULTS = [
    (np.ones((3, 6), np.float32), "physg", r"shape \[3, 6\]; expected \[N, 7\], or \[F, N, 7\]"),
    (np.ones(7, np.float32), "physg", r"shape \[7\]; expected"),
    (np.ones((1, 2, 3, 7), np.float32), "nerd", r"shape \[1, 2, 3, 7\]; expected"),
    (np.ones((3, 7), np.int32), "physg", "holds int32 numbers; expected floating point"),
    (np.array([[None] * 7]), "physg", r"is no whole \.npy array \(.*\); expected a \.npy file"),
    (with_value(np.nan, 5), "physg", PLACE + "a number that is not finite in float32; expected"),
    (with_value(np.inf, 0), "nerd", PLACE + "a number that is not finite in float32"),
    (1e300 * np.ones((1, 7)), "physg", "row 0 has a number that is not finite in float32"),
    (with_value(-3, 6), "nerd", PLACE + "a negative sharpness; expected from 0 up"),
    (np.zeros((1, 7), np.float32), "physg", "row 0 has an axis of length 0; expected a direction"),
]


@pytest.mark.parametrize(("array", "layout", "message"), FAULTS)
def test_an_array_of_something_else_is_one_line(
    tmp_path: Path, array: NDArray[np.generic], layout: str, message: str
) -> None:
    np.save(tmp_path / "a.npy", array)
    with pytest.raises(InputError, match=message) as fault:
        read_sg_array(tmp_path / "a.npy", SgLayout(layout))
    assert "\n" not in str(fault.value)


def test_what_is_no_npy_file_is_one_line(tmp_path: Path) -> None:
    np.save(tmp_path / "good.npy", GOOD)
    np.savez(tmp_path / "archive.npy.npz", GOOD)
    whole = (tmp_path / "good.npy").read_bytes()
    for content in (
        b"",
        whole[:5],
        whole[:60],
        whole[:-1],
        b"\0" * 200,
        pickle.dumps([1.0, 2.0]),
        (tmp_path / "archive.npy.npz").read_bytes(),
        whole.replace(b"'shape'", b"'shap('"),
    ):
        (tmp_path / "a.npy").write_bytes(content)
        with pytest.raises(InputError, match=r"a\.npy: is no whole \.npy array"):
            read_sg_array(tmp_path / "a.npy", SgLayout.PHYSG)
    with pytest.raises(InputError, match=r"none\.npy: cannot be read \(No such file"):
        read_sg_array(tmp_path / "none.npy", SgLayout.PHYSG)


@pytest.mark.filterwarnings("ignore:Reading `.npy`")  # numpy's, of headers that Python 2 wrote
def test_a_damaged_header_never_ends_in_another_fault(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", GOOD)
    whole = (tmp_path / "a.npy").read_bytes()
    random = np.random.default_rng(0)
    refused = 0
    for _ in range(1500):
        content = bytearray(whole)
        for place in random.integers(0, 128, random.integers(1, 4)):
            content[place] = random.integers(0, 256)
        (tmp_path / "a.npy").write_bytes(content)
        try:
            read_sg_array(tmp_path / "a.npy", SgLayout.PHYSG)
        except InputError:
            refused += 1
    assert refused > 750  # half of the header is padding


def test_too_many_samples_are_refused_both_ways(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    np.save(tmp_path / "a.npy", GOOD)
    monkeypatch.setattr("asglight.export.track_file.SAMPLES_MAX", 5)
    with pytest.raises(InputError, match="3 lobes in 2 frames; expected at most 5 together"):
        read_sg_array(tmp_path / "a.npy", SgLayout.PHYSG)
    with pytest.raises(InputError, match="5 lobes in 3 frames; expected at most 5 together"):
        write_sg_array(tmp_path / "b.npy", soft(), SgLayout.NERD)
    assert not (tmp_path / "b.npy").exists()


def test_the_tracks_stay_as_they_are(tmp_path: Path) -> None:
    tracks = soft()
    before = replace(tracks, lobes=tracks.lobes.clone())
    write_sg_array(tmp_path / "a.npy", tracks, SgLayout.NERD)
    assert torch.equal(tracks.lobes.axes, before.lobes.axes)


def test_a_shape_that_no_number_can_count_is_one_line(tmp_path: Path) -> None:
    path = tmp_path / "a.npy"
    np.save(path, np.zeros((3, 7), np.float32))
    data = path.read_bytes()
    path.write_bytes(data.replace(b"(3, 7), }" + b" " * 20, b"(99999999999999999999, 7), }"[:29]))
    with pytest.raises(InputError, match=r"a\.npy: is no whole \.npy array"):
        read_sg_array(path, SgLayout.PHYSG)
