# SPDX-License-Identifier: Apache-2.0
"""What a notebook shows: pictures, and one line for each object."""

import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from matplotlib.image import imread
from usd_tracks import moving

import asglight
from asglight.errors import InputError
from asglight.lobes import LobeTracks

SHOT = moving(range(1001, 1005))


def test_a_notebook_shows_a_png_of_the_time() -> None:
    first, same, later = (
        imread(io.BytesIO(asglight.plot(SHOT, time)._repr_png_())) for time in (1001, 1001, 1003.5)
    )
    assert first.shape[0] > 500
    assert np.array_equal(first, same)
    assert not np.array_equal(first, later)


def test_lobes_and_stills_are_drawn_without_a_time(tmp_path: Path) -> None:
    still = LobeTracks((7,), 24.0, SHOT.lobes[:1])
    asglight.plot(still).save(tmp_path / "still.png")
    asglight.plot(SHOT.at(1001), exposure=1.0).save(tmp_path / "lobes.png")
    for name in ("still", "lobes"):
        picture = imread(tmp_path / f"{name}.png")[..., :3]
        assert float(picture[100:430, 30:740].max()) > 0.5  # the map has light in it
    with pytest.raises(InputError, match=r"none/a.png: cannot be written \(no folder none"):
        asglight.plot(still).save("none/a.png")


def test_exposure_is_in_stops() -> None:
    dim, bright = (
        imread(io.BytesIO(asglight.plot(SHOT, 1001, exposure=stops)._repr_png_()))[100:430, 30:740]
        for stops in (-8.0, -2.0)
    )
    assert float(bright[..., :3].mean()) > 2 * float(dim[..., :3].mean())


@pytest.mark.parametrize("stops", [float("nan"), float("inf"), 1e4])
def test_an_exposure_that_shows_nothing_is_refused(stops: float) -> None:
    with pytest.raises(InputError, match=r"exposure: .*; expected -150 to 150 stops"):
        asglight.plot(SHOT, 1001, exposure=stops)


def test_a_time_may_be_a_number_of_numpy_or_torch() -> None:
    wanted = asglight.plot(SHOT, 1002)._repr_png_()
    for time in (np.int64(1002), np.float32(1002), np.array(1002), torch.tensor(1002.0)):
        assert asglight.plot(SHOT, time)._repr_png_() == wanted
    with pytest.raises(InputError, match=r"time: \[1001, 1002\]; expected one time for a picture"):
        asglight.plot(SHOT, [1001, 1002])


def test_objects_say_what_one_has() -> None:
    fitted = replace(SHOT, metadata={"preset": "fast", "source": "sky.####.exr"})
    assert repr(fitted) == (
        "<LobeTracks: 3 lobes of form asg, 4 frames 1001-1004 at 24 fps, preset fast, source "
        "sky.####.exr>"
    )
    still = LobeTracks((7,), 23.976, SHOT.lobes[:1])
    assert repr(still) == "<LobeTracks: 3 lobes of form asg, frame 7 at 23.976 fps>"
    assert repr(LobeTracks((), 24.0, SHOT.lobes[:0])).endswith("0 frames at 24 fps>")
    assert repr(SHOT.lobes) == "<Lobes: 3 of form asg, of each [4], 12 lit, float32 on cpu>"
    assert repr(SHOT.at(1001)) == "<Lobes: 3 of form asg, 3 lit, float32 on cpu>"
