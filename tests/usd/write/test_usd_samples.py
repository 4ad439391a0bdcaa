# SPDX-License-Identifier: Apache-2.0
"""Left-out samples come back: interpolation as USD itself does it is the reference."""

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd
from scipy.spatial.transform import Rotation, Slerp

from asglight.usd.write.samples import kept, kept_quaternions

FRAMES = np.arange(1001.0, 1101.0)


def interpolated(values, keep, kind):
    """Author the kept samples on a stage and read every frame back."""
    stage = Usd.Stage.CreateInMemory()
    attribute = stage.DefinePrim("/a").CreateAttribute("a", kind)
    for index in np.flatnonzero(keep):
        attribute.Set(values[index], FRAMES[index])
    return [attribute.Get(frame) for frame in FRAMES]


def quaternions(rotations):
    return np.roll(rotations.as_quat(), 1, axis=-1).astype(np.float32).astype(np.float64)


def test_a_ramp_keeps_its_ends():
    ramp = (np.linspace(1e-3, 1e3, 100)[:, None] * [1, 2]).astype(np.float32).astype(float)
    keep = kept(ramp, FRAMES, 1e-6)
    assert np.flatnonzero(keep).tolist() == [0, 99]
    read = interpolated([Gf.Vec2f(*row) for row in ramp], keep, Sdf.ValueTypeNames.Float2)
    np.testing.assert_allclose(np.array(read), ramp, rtol=1.1e-6)  # plus float32 rounding


def test_a_polyline_keeps_its_corners():
    values = np.interp(FRAMES, [1001, 1020, 1021, 1100], [1, 5, 2, 2.5])[:, None]
    keep = kept(values, FRAMES, 1e-9)
    assert np.flatnonzero(keep).tolist() == [0, 19, 20, 99]


def test_what_is_left_out_comes_back_within_the_tolerance():
    curve = np.exp(3 * np.sin(FRAMES / 40))[:, None].astype(np.float32).astype(float)
    keep = kept(curve, FRAMES, 1e-2)
    assert 2 < keep.sum() < 50
    read = interpolated([float(v) for v in curve[:, 0]], keep, Sdf.ValueTypeNames.Float)
    np.testing.assert_allclose(read, curve[:, 0], rtol=1.0001e-2)


def test_small_values_beside_large_ones_keep_their_digits():
    decades = 10.0 ** np.linspace(-4, 5, 100)[:, None]
    assert kept(decades, FRAMES, 1e-6).all()


def test_a_zero_is_never_replaced_by_a_small_number():
    values = np.full((100, 1), 1e-30)
    values[50] = 0
    keep = kept(values, FRAMES, 1e-6)
    assert keep[50]
    values[:] = 3e38  # the largest float32 beside the smallest tolerance
    values[50] = 0
    assert kept(values, FRAMES, 1e-6)[50]


def test_noise_is_kept_whole():
    noise = np.random.default_rng(0).uniform(1, 2, (100, 3))
    assert kept(noise, FRAMES, 1e-6).all()


def test_uneven_frames_are_interpolated_by_their_numbers():
    frames = np.array([0.0, 1.0, 5.0, 6.0])
    on_line = 2 + frames[:, None]
    assert np.flatnonzero(kept(on_line, frames, 1e-9)).tolist() == [0, 3]
    assert kept(np.array([[2.0], [3.0], [4.0], [5.0]]), frames, 1e-9).all()


@pytest.mark.parametrize("count", [1, 2])
def test_a_constant_keeps_nothing(count):
    assert not kept(np.full((count, 2), 3.0), FRAMES[:count], 1e-6).any()


def test_a_steady_turn_keeps_its_ends():
    ends = Rotation.from_rotvec([[0.1, 0.2, 0.3], [1.0, -0.5, 0.6]])
    turn = quaternions(Slerp(FRAMES[[0, -1]], ends)(FRAMES))
    keep = kept_quaternions(turn, FRAMES)
    assert np.flatnonzero(keep).tolist() == [0, 99]
    read = interpolated([Gf.Quatf(*row) for row in turn.tolist()], keep, Sdf.ValueTypeNames.Quatf)
    back = Rotation.from_quat([[*q.GetImaginary(), q.GetReal()] for q in read])
    wanted = Rotation.from_quat(np.roll(turn, -1, axis=-1))
    assert (back * wanted.inv()).magnitude().max() < 1e-6


def test_two_full_turns_come_back():
    turn = quaternions(Rotation.from_rotvec(np.linspace(0, 4 * np.pi, 100)[:, None] * [0, 1, 0]))
    signs = np.cumprod(np.r_[1, np.sign((turn[1:] * turn[:-1]).sum(-1))])
    turn *= signs[:, None]
    keep = kept_quaternions(turn, FRAMES)
    assert 4 < keep.sum() < 60
    read = interpolated([Gf.Quatf(*row) for row in turn.tolist()], keep, Sdf.ValueTypeNames.Quatf)
    back = Rotation.from_quat([[*q.GetImaginary(), q.GetReal()] for q in read])
    wanted = Rotation.from_quat(np.roll(turn, -1, axis=-1))
    assert (back * wanted.inv()).magnitude().max() < 1e-6
