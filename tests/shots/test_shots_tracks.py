# SPDX-License-Identifier: Apache-2.0
import json
import math
from pathlib import Path

import pytest
import shot_files
import sky_files
import torch

import asglight
from asglight.images import Repair, Sequence, open_sequence
from asglight.shots.tracks import lit_lobes, repairs_of, tracks_from


@pytest.fixture
def sequence(tmp_path: Path) -> Sequence:
    return open_sequence(sky_files.write_sequence(tmp_path / "in", range(1, 4)))


def black(frame: int, *indices: int) -> object:
    """Return a record in which some lobes are black."""
    record = shot_files.record(frame, lobes=shot_files.lobes(frame, count=3))
    record.lobes.amplitude[list(indices)] = 0
    return record


def test_a_lobe_black_in_every_frame_is_left_out_and_counted(sequence: Sequence) -> None:
    records = [black(1, 1), black(2, 0, 1), black(3, 1, 2)]
    tracks = tracks_from(records, sequence, shot_files.OPTIONS, 24.0)
    assert tracks.lobes.count == 2
    assert tracks.metadata["left_out"]["black"] == 1
    assert torch.equal(tracks.lobes.amplitude[0], records[0].lobes.amplitude[[0, 2]])


def test_a_black_shot_keeps_one_lobe(sequence: Sequence) -> None:
    records = [black(frame, 0, 1, 2) for frame in (1, 2, 3)]
    tracks = tracks_from(records, sequence, shot_files.OPTIONS, 24.0)
    assert (tracks.lobes.count, tracks.metadata["left_out"]["black"]) == (1, 2)


def test_a_lobe_lit_in_one_channel_is_lit() -> None:
    lobes = shot_files.lobes(1, count=2)
    lobes.amplitude[:] = torch.tensor([[0.0, 0.0, 0.0], [0.0, 0.0, 1e-30]])
    assert lit_lobes(lobes[None]).tolist() == [False, True]


def test_the_axes_do_not_jump_between_equal_frames(sequence: Sequence) -> None:
    first = shot_files.record(1)
    turned = shot_files.record(2, lobes=shot_files.lobes(1))
    turned.lobes.axes[:, :2] *= -1  # the same lobes, their frames turned by 180 degrees about z
    records = [first, turned, shot_files.record(3, lobes=shot_files.lobes(1))]
    axes = tracks_from(records, sequence, shot_files.OPTIONS, 24.0).lobes.axes
    # 1e-6: products of float32 unit vectors
    torch.testing.assert_close(axes[0], axes[1], rtol=0, atol=1e-6)
    torch.testing.assert_close(axes[1], axes[2], rtol=0, atol=1e-6)


def test_the_metadata_is_json_and_holds_no_time_and_no_absolute_path(
    sequence: Sequence, tmp_path: Path
) -> None:
    records = [shot_files.record(1), shot_files.record(2, loss=math.inf), shot_files.record(3)]
    tracks = tracks_from(records, sequence, shot_files.OPTIONS, 24.0)
    text = json.dumps(dict(tracks.metadata), allow_nan=False)
    assert str(tmp_path) not in text
    assert "seconds" not in text
    assert tracks.metadata["source"] == "sky.#.exr"
    assert tracks.metadata["asglight"] == asglight.__version__
    assert tracks.metadata["loss"] == [records[0].loss, None, records[2].loss]
    assert tracks.metadata["flux_error"] == [-1e-7] * 3


def test_repairs_are_summed_once_and_their_frames_named() -> None:
    repairs = {
        1: Repair(negative=5),
        2: Repair(infinite=4),
        3: Repair(nonfinite=2, negative=1),
        4: Repair(nonfinite=2, negative=1, filled_from=(3,)),
        5: Repair(filled_from=(3, 6)),
    }
    assert repairs_of(repairs) == {
        "negative_texels": 6,
        "nonfinite_texels": 2,
        "infinite_texels": 4,
        "frames": [1, 2, 3],
        "frames_filled": [4, 5],
    }
