# SPDX-License-Identifier: Apache-2.0
"""Lobes and tracks as data: shapes are checked with a message, indexing keeps lobes whole."""

import dataclasses

import lobe_samples
import pytest
import torch

from asglight.lobes import Form, Lobes, LobeTracks
from asglight.lobes.data import chosen, stack


def _lobes(count: int = 2, **changed: torch.Tensor) -> Lobes:
    sample = lobe_samples.random_lobes(count, Form.ASG)
    parts = {"axes": sample.axes, "sharpness": sample.sharpness, "amplitude": sample.amplitude}
    parts |= changed
    return Lobes(parts["axes"], parts["sharpness"], parts["amplitude"])


@pytest.mark.parametrize(
    ("name", "shape", "message"),
    [
        ("axes", (2, 3), r"axes: shape \(2, 3\), expected \[\.\.\., N, 3, 3\]"),
        ("axes", (2, 3, 2), r"axes: shape \(2, 3, 2\), expected \[\.\.\., N, 3, 3\]"),
        ("sharpness", (2, 3), r"sharpness: shape \(2, 3\), expected \[\.\.\., N, 2\]"),
        ("sharpness", (2,), r"sharpness: shape \(2,\), expected \[\.\.\., N, 2\]"),
        ("amplitude", (2, 4), r"amplitude: shape \(2, 4\), expected \[\.\.\., N, 3\]"),
        ("amplitude", (3, 3), r"amplitude: shape \(3, 3\), expected \[\.\.\., N, 3\]"),
    ],
)
def test_a_wrong_shape_is_named_with_what_was_expected(
    name: str, shape: tuple[int, ...], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        _lobes(2, **{name: torch.zeros(shape)})


def test_lobes_are_asg_by_default_and_cannot_be_changed() -> None:
    lobes = _lobes()
    assert lobes.form is Form.ASG
    with pytest.raises(dataclasses.FrozenInstanceError):
        lobes.form = Form.SG  # pyright: ignore[reportAttributeAccessIssue]


def test_forms_are_written_by_their_names() -> None:
    assert [str(form) for form in Form] == ["asg", "bingham", "sg", "flat"]


def test_axes_are_the_rows_of_the_frame() -> None:
    lobes = _lobes(4)
    assert lobes.count == 4
    for row, axis in enumerate((lobes.axis_x, lobes.axis_y, lobes.axis_z)):
        assert torch.equal(axis, lobes.axes[:, row])


def test_indexing_stacking_and_selecting_agree() -> None:
    frames = [lobe_samples.random_lobes(3, Form.BINGHAM, seed) for seed in range(4)]
    stacked = stack(frames)
    assert stacked.axes.shape == (4, 3, 3, 3)
    assert stacked.count == 3
    picked = stacked[2].select(torch.tensor([2, 0]))
    by_mask = stacked[2].select(torch.tensor([True, False, True]))
    assert picked.form is by_mask.form is Form.BINGHAM
    for field in ("axes", "sharpness", "amplitude"):
        expected = getattr(frames[2], field)
        assert torch.equal(getattr(picked, field), expected[[2, 0]])
        assert torch.equal(getattr(by_mask, field), expected[[0, 2]])


def test_replacing_puts_others_where_selecting_picks() -> None:
    lobes = stack([lobe_samples.random_lobes(3, Form.ASG, seed=seed) for seed in range(2)])
    others = stack([lobe_samples.random_lobes(2, Form.ASG, seed=seed) for seed in (8, 9)])
    for places in (torch.tensor([2, 0]), torch.tensor([True, False, True])):
        before = lobes.clone()
        found = lobes.replaced(places, others)
        for field in ("axes", "sharpness", "amplitude"):
            assert torch.equal(getattr(found.select(places), field), getattr(others, field))
            assert torch.equal(getattr(found, field)[:, 1], getattr(lobes, field)[:, 1])
            assert torch.equal(getattr(lobes, field), getattr(before, field))


def test_conversion_converts_every_tensor_and_keeps_the_form() -> None:
    lobes = lobe_samples.random_lobes(2, Form.SG).to(torch.float32)
    dtypes = {lobes.axes.dtype, lobes.sharpness.dtype, lobes.amplitude.dtype}
    assert dtypes == {torch.float32}
    assert lobes.form is Form.SG


def _tracks(frames: tuple[int, ...], count: int) -> LobeTracks:
    lobes = stack([lobe_samples.random_lobes(2, Form.ASG, seed) for seed in range(count)])
    return LobeTracks(frames, 24.0, lobes)


def test_tracks_give_the_lobes_of_a_frame_number() -> None:
    tracks = _tracks((1001, 1002, 1010), 3)
    assert torch.equal(tracks.at(1010).axes, tracks.lobes.axes[2])
    assert tracks.metadata == {}


def test_tracks_name_a_missing_frame() -> None:
    with pytest.raises(KeyError, match=r"frame 1003: not in 1001-1010 \(3\)"):
        _tracks((1001, 1002, 1010), 3).at(1003)


def test_tracks_reject_another_number_of_frames_than_lobes() -> None:
    message = r"frames: 2 frame numbers for lobes of shape \(3, 2\); expected \[F, N\]"
    with pytest.raises(ValueError, match=message):
        _tracks((1, 2), 3)


def test_tracks_reject_lobes_without_a_frame_dimension() -> None:
    with pytest.raises(ValueError, match=r"lobes of shape \(2,\); expected \[F, N\]"):
        LobeTracks((1, 2), 24.0, lobe_samples.random_lobes(2, Form.ASG))


@pytest.mark.parametrize("frames", [(2, 1), (1, 1)])
def test_tracks_reject_frames_out_of_order(frames: tuple[int, int]) -> None:
    with pytest.raises(ValueError, match="frames: not ascending"):
        _tracks(frames, 2)


def test_frames_are_chosen_whole() -> None:
    one, other = (stack([_lobes(3), _lobes(3), _lobes(3)]) for _ in range(2))
    other = dataclasses.replace(
        other, axes=-other.axes, sharpness=2 * other.sharpness, amplitude=3 * other.amplitude
    )
    found = chosen(torch.tensor([True, False, True]), one, other)
    for name in ("axes", "sharpness", "amplitude"):
        value = getattr(found, name)
        assert torch.equal(value[[0, 2]], getattr(one, name)[[0, 2]])
        assert torch.equal(value[1], getattr(other, name)[1])
