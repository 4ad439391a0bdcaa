# SPDX-License-Identifier: Apache-2.0
"""Parts of a shot, joined: what was one lobe is one track again, and nothing pops."""

from dataclasses import replace

import lobe_samples
import numpy as np
import pytest
import torch
import usd_tracks
from scipy.spatial.transform import Rotation

from asglight.errors import InputError
from asglight.lobes import Form, Lobes, LobeTracks, asg
from asglight.lobes.stitching import stitched

DIRECTIONS = lobe_samples.random_directions(200)


def along(degrees: list[list[float]], light: object = 1.0, sharpness: float = 50.0) -> Lobes:
    """Return lobes on the equator at an angle for each frame and lobe, in float64.  [F, N, .]."""
    turns = Rotation.from_euler("y", np.reshape(degrees, (-1, 1)), degrees=True)
    axes = torch.from_numpy(usd_tracks.rows(turns)).reshape(*np.shape(degrees), 3, 3)
    size = axes.shape[:2]
    amplitude = torch.from_numpy(np.broadcast_to(np.array(light, float), size).copy())
    return Lobes(
        axes, torch.full((*size, 2), sharpness).double(), amplitude[..., None].repeat(1, 1, 3)
    )


def part(first: int, lobes: Lobes, fps: float = 24.0) -> LobeTracks:
    return LobeTracks(tuple(range(first, first + len(lobes.axes))), fps, lobes, {"first": first})


def cut(tracks: LobeTracks, start: int, stop: int) -> LobeTracks:
    return replace(tracks, frames=tracks.frames[start:stop], lobes=tracks.lobes[start:stop])


def disguised(tracks: LobeTracks, seed: int) -> LobeTracks:
    """Shuffle the lobes and write each with other axes that stand for the same function."""
    random = np.random.default_rng(seed)
    lobes = tracks.lobes.select(torch.from_numpy(random.permutation(tracks.lobes.count)))
    axes, sharpness = lobes.axes.clone(), lobes.sharpness.clone()
    for k in range(lobes.count):
        x, y, z = axes[:, k].unbind(1)
        if k % 3 == 0:  # a quarter turn
            axes[:, k], sharpness[:, k] = torch.stack([y, -x, z], 1), sharpness[:, k].flip(-1)
        elif k % 3 == 1:  # half a turn
            axes[:, k] = torch.stack([-x, -y, z], 1)
        else:  # mirrored: no frame that asglight writes, but the same function
            axes[:, k] = torch.stack([x, -y, z], 1)
        if lobes.form is Form.BINGHAM and k % 2:
            axes[:, k, 1:] *= -1
    return replace(tracks, lobes=replace(lobes, axes=axes, sharpness=sharpness))


def radiance(lobes: Lobes) -> torch.Tensor:
    """Return what each lobe sends from some directions.  [F, N, P, 3]."""
    lobes = lobes.to(torch.float64)
    return asg.unit_lobes(lobes, DIRECTIONS)[..., None] * lobes.amplitude[..., None, :]


def jumps(lobes: Lobes) -> int:
    """Count turns by more than 10 degrees of lobes with 1 % of the flux before or after."""
    flux = asg.flux(lobes.to(torch.float64)).sum(-1)
    share = flux / flux.sum(-1, keepdim=True)
    cosine = (lobes.axis_z[1:].double() * lobes.axis_z[:-1].double()).sum(-1)
    lit = torch.maximum(share[1:], share[:-1]) > 0.01
    return int((lit & (cosine < np.cos(np.radians(10)))).sum())


@pytest.mark.parametrize("form", list(Form))
@pytest.mark.parametrize("overlap", [0, 1, 4])
def test_a_shot_that_was_cut_is_found_again(form: Form, overlap: int) -> None:
    whole = usd_tracks.moving(range(1001, 1061), 7, form)
    bounds = [(0, 20 + overlap), (20, 41 + overlap), (41, 60)]
    parts = [disguised(cut(whole, *bounds[k]), seed=k) for k in (1, 2)]
    result = stitched([parts[1], cut(whole, *bounds[0]), parts[0]])
    assert result.frames == whole.frames
    assert (result.fps, result.metadata) == (whole.fps, whole.metadata)
    assert result.lobes.count == 7
    expected = radiance(whole.lobes)
    # a float32 rounding of axes, times the steepest lobe (sharpness 135) twice
    assert (radiance(result.lobes) - expected).abs().max() < 3e-5 * expected.max()
    gram = result.lobes.axes @ result.lobes.axes.mT
    assert (gram - torch.eye(3)).abs().max() < 1e-6  # a few float32 roundings
    assert (torch.linalg.det(result.lobes.axes) - 1).abs().max() < 1e-6


def test_one_part_is_the_shot() -> None:
    whole = usd_tracks.moving(range(5, 9), 3)
    result = stitched([whole])
    assert result.frames == whole.frames
    expected = radiance(whole.lobes)
    assert (radiance(result.lobes) - expected).abs().max() < 3e-5 * expected.max()


def test_frames_of_one_part_are_as_they_were_and_overlaps_have_the_flux_of_the_blend() -> None:
    first = usd_tracks.moving(range(1, 11), 5, seed=1)
    last = usd_tracks.moving(range(7, 21), 3, seed=2)
    lobes = stitched([first, last]).lobes
    assert 5 <= lobes.count <= 8
    whole = radiance(lobes).sum(1)
    outside = torch.cat([radiance(first.lobes[:6]).sum(1), radiance(last.lobes[4:]).sum(1)])
    found = torch.cat([whole[:6], whole[10:]])
    assert (found - outside).abs().max() < 3e-5 * outside.max()  # as above
    flux = asg.flux(lobes.to(torch.float64)).sum(1)[6:10]
    part = torch.arange(1, 5).double()[:, None] / 5
    before = asg.flux(first.lobes[6:].to(torch.float64)).sum(1)
    after = asg.flux(last.lobes[:4].to(torch.float64)).sum(1)
    expected = (1 - part) * before + part * after
    assert ((flux - expected).abs() / expected).max() < 1e-6  # float32 roundings of 8 lobes


def test_a_pair_meets_half_way() -> None:
    before = along([[0.0]] * 3, light=1.0, sharpness=40.0)
    after = along([[6.0]] * 3, light=3.0, sharpness=90.0)
    lobes = stitched([part(1, before), part(3, after)]).lobes.to(torch.float64)
    assert lobes.count == 1
    angle = torch.rad2deg(torch.atan2(lobes.axis_z[:, 0, 0], lobes.axis_z[:, 0, 2]))
    # float32: 1e-7 radians are 6e-6 degrees
    assert torch.allclose(angle, torch.tensor([0, 0, 3, 6, 6]).double(), atol=2e-5)
    assert torch.allclose(lobes.sharpness[2], torch.tensor(60.0).double(), rtol=1e-6)
    flux = asg.flux(lobes)[:, 0, 0]
    assert float(flux[2]) == pytest.approx(float(flux[1] + flux[3]) / 2, rel=1e-6)


def test_a_pair_that_is_far_apart_is_faded_as_two_tracks() -> None:
    before, after = along([[0.0, 90.0]] * 8), along([[120.0, 30.0]] * 8)
    after.axes[:, 0] = before.axes[0, 1]  # goes on where it was
    lobes = stitched([part(1, before), part(5, after)]).lobes
    assert lobes.count == 3
    assert jumps(lobes) == 0
    weight = torch.tensor([0, 0, 0, 0, 0.2, 0.4, 0.6, 0.8, 1, 1, 1, 1]).double()
    start, end = (radiance(one).sum(1)[0] for one in (before, after))
    expected = start + weight[:, None, None] * (end - start)
    assert (radiance(lobes).sum(1) - expected).abs().max() < 1e-5  # float32, sharpness 50
    assert lobes.amplitude[4:, 1].min() > 0.9  # the one that stays
    assert float(lobes.amplitude[8:, 0].max()) == 0.0
    assert float(lobes.amplitude[:4, 2].max()) == 0.0


def test_a_pair_that_would_turn_too_fast_on_the_way_is_faded() -> None:
    """Each part turns by 9 degrees a frame, and the later one is 6 degrees ahead."""
    before = along([[9.0 * frame] for frame in range(6)])
    after = along([[9.0 * frame + 6] for frame in range(4, 10)])
    assert jumps(stitched([part(1, before), part(5, after)]).lobes) == 0
    assert stitched([part(1, before), part(5, after)]).lobes.count == 2
    still = stitched([part(1, along([[0.0]] * 6)), part(5, along([[6.0]] * 6))])
    assert still.lobes.count == 1


@pytest.mark.parametrize(("form", "factor"), [(Form.ASG, 2.0), (Form.SG, 1.0)])
@pytest.mark.parametrize("share", [0.95, 1.05])
def test_a_wide_lobe_is_carried_by_its_own_width(form: Form, factor: float, share: float) -> None:
    """Up to sqrt(2) times half a standard deviation at sharpness s + 1/2, and no further."""
    sharpness = 0.5
    sigma = np.degrees(1 / np.sqrt(factor * (sharpness + 0.5)))
    turn = share * np.sqrt(2) * sigma / 2
    before, after = (
        replace(along([[angle]] * 8, sharpness=sharpness), form=form) for angle in (0.0, turn)
    )
    lobes = stitched([part(1, before), part(5, after)]).lobes
    assert lobes.count == (1 if share < 1 else 2)
    assert jumps(lobes) == 0


@pytest.mark.parametrize("axis", [0, 1])
def test_a_band_is_carried_along_itself_and_not_across(axis: int) -> None:
    """`along` turns about y: the tilt is along axis x."""
    before, after = along([[0.0]] * 8), along([[25.0]] * 8)
    for lobes in (before, after):
        lobes.sharpness[..., axis], lobes.sharpness[..., 1 - axis] = 0.0, 30.0
    assert stitched([part(1, before), part(5, after)]).lobes.count == 1 + axis


def test_the_nearest_of_all_pairs_wins_not_of_each() -> None:
    """Lobe 0 is nearest to the second of the next part, but so is lobe 1, and more so."""
    before, after = along([[0.0, 8.0]] * 4), along([[-5.0, 4.5]] * 4)
    lobes = stitched([part(1, before), part(5, after)]).lobes
    assert lobes.count == 2
    angle = torch.rad2deg(torch.atan2(lobes.axis_z[-1, :, 0], lobes.axis_z[-1, :, 2]))
    assert torch.allclose(angle, torch.tensor([-5.0, 4.5]), atol=2e-5)


def test_a_narrow_lamp_does_not_become_the_sky_around_it() -> None:
    before = along([[0.0, 4.0]] * 4, [[100.0, 1.0]] * 4)
    before.sharpness[:, 1] = 2.0
    after = before.select(torch.tensor([1, 0]))
    lobes = stitched([part(1, before), part(3, after)]).lobes
    assert lobes.count == 2
    assert torch.allclose(lobes.sharpness[-1, :, 0], torch.tensor([50.0, 2.0]))


@pytest.mark.parametrize("backwards", [False, True])
def test_a_dark_track_is_used_again(backwards: bool) -> None:
    """A lobe goes out, and after the seam another one lights up: one track, that turns unseen."""
    gone = along([[0.0, 90.0]] * 9, [[1.0, 1.0]] * 3 + [[1.0, 0.0]] * 6)
    come = along([[0.0, 200.0]] * 9)
    parts = [part(1, gone), part(6, come)]
    if backwards:
        flip = torch.arange(8, -1, -1)
        parts = [part(1, come[flip]), part(6, gone[flip])]
    lobes = stitched(parts).lobes
    assert lobes.count == 2
    assert jumps(lobes) == 0
    # the light of the far lobe is where it was fitted, or nowhere
    places = parts[0].lobes.axis_z[0, 1], parts[1].lobes.axis_z[-1, 1]
    lit = lobes.amplitude[:, 1, 0] > 0
    nearest = torch.stack([lobes.axis_z[:, 1].double() @ place for place in places]).amax(0)
    assert nearest[lit].min() > 1 - 1e-6
    assert lit.sum() == 12


def test_parts_of_different_counts_and_a_part_of_a_frame() -> None:
    first = part(1, along([[0.0, 50.0, 100.0]] * 2))
    last = part(3, along([[100.0]]))
    lobes = stitched([last, first]).lobes
    assert lobes.count == 3
    assert lobes.amplitude[2, :, 0].tolist() == [0.0, 0.0, 1.0]


def test_a_black_part_is_stitched() -> None:
    lit, black = along([[0.0, 50.0]] * 4), along([[10.0, 80.0]] * 4, 0.0)
    lobes = stitched([part(1, lit), part(3, black)]).lobes
    assert torch.isfinite(lobes.axes).all()
    assert lobes.amplitude[-1].max() == 0
    assert lobes.count == 2
    assert jumps(lobes[:4]) == 0


def test_every_second_frame_is_no_gap() -> None:
    lobes = along([[0.0]] * 3)
    parts = [LobeTracks((1, 3, 5), 24.0, lobes), LobeTracks((7, 9, 11), 24.0, lobes)]
    assert stitched(parts).frames == (1, 3, 5, 7, 9, 11)


LAMP = along([[0.0]] * 4)
FAULTS = [
    ([], "parts: none"),
    ([part(1, LAMP), part(5, LAMP, 25.0)], "5-8: 25 fps, but 1-4 has 24"),
    ([part(1, LAMP), part(5, replace(LAMP, form=Form.SG))], "5-8: lobes of form sg, but 1-4 has"),
    ([part(1, LAMP), part(7, LAMP)], "1-4 and 7-10: between them frames are missing (5-6)"),
    ([part(1, LAMP), part(6, LAMP)], "1-4 and 6-9: between them frames are missing (5)"),
    ([part(1, LAMP), part(1, LAMP)], "1-4: frames 1-4 beside 1-4 of 1-4"),
    ([part(1, LAMP), part(2, LAMP[:3])], "2-4: frames 2-4 beside 1-4 of 1-4"),
    (
        [LobeTracks((1, 3, 5, 7), 24.0, LAMP), LobeTracks((6, 8, 10, 12), 24.0, LAMP)],
        "1-7 and 6-12: different frames in 6-7",
    ),
]


@pytest.mark.parametrize(("parts", "message"), FAULTS)
def test_parts_that_make_no_shot_are_told(parts: list[LobeTracks], message: str) -> None:
    with pytest.raises(InputError) as error:
        stitched(parts[::-1])
    assert str(error.value).startswith(message)
    assert "\n" not in str(error.value)
    assert "expected" in str(error.value)


def test_names_stand_in_messages() -> None:
    with pytest.raises(InputError, match=r"a\.usdc and b\.usdc: between them"):
        stitched([part(7, LAMP), part(1, LAMP)], ["b.usdc", "a.usdc"])


def test_a_light_of_a_later_part_keeps_its_name_where_it_is_free() -> None:
    """As where each part was fitted with --names-from, and one light is not seen in the first."""
    first = replace(part(1, LAMP), names=("lobe_00",))
    later = replace(part(3, along([[0.0, 120.0]] * 4)), names=("lobe_00", "lobe_02"))
    assert stitched([first, later]).names == ("lobe_00", "lobe_02")
    taken = replace(later, names=("lobe_04", "lobe_00"))
    assert stitched([first, taken]).names == ("lobe_00", "lobe_05")


def test_what_a_person_calls_a_light_stays_with_it() -> None:
    first = replace(part(1, LAMP), display_names={"lobe_00": "Sun"})
    both = part(3, along([[120.0, 0.0]] * 4))
    later = replace(both, names=("lobe_07", "lobe_00"), display_names={"lobe_07": "Tube"})
    assert stitched([first, later]).display_names == {"lobe_00": "Sun", "lobe_07": "Tube"}
