# SPDX-License-Identifier: Apache-2.0
"""A session without a window: lobes that arrive, the playhead, and the reference beside it."""

from collections.abc import Callable

import numpy as np
import pytest
import torch

from asglight.errors import InputError
from asglight.lobes import LobeTracks
from asglight.viewer.panels.curves import without_curves
from asglight.viewer.panels.help import said
from asglight.viewer.reference.images import Reference
from asglight.viewer.state.compared.titles import titles
from asglight.viewer.state.session import Session, no_lobes, padded
from asglight.viewer.state.source import FixedSource, SourceStatus
from asglight.viewer.state.viewer_state import ViewerState


class Script:
    """A source that gives one entry of a list a poll, then its end."""

    def __init__(self, news: list[LobeTracks | None], failure: str | None = None) -> None:
        self.news = news
        self.failure = failure
        self.is_closed = False

    def poll(self) -> LobeTracks | None:
        return self.news.pop(0) if self.news else None

    def status(self) -> SourceStatus:
        is_finished = not self.news
        failure = self.failure if is_finished else None
        return SourceStatus(0, 3, is_finished=is_finished, failure=failure)

    def close(self) -> None:
        self.is_closed = True


def first(tracks: LobeTracks, count: int) -> LobeTracks:
    return LobeTracks(tracks.frames[:count], tracks.fps, tracks.lobes[:count], tracks.metadata)


def session(source: Script, tracks: LobeTracks) -> Session:
    return Session(ViewerState(no_lobes(tracks.frames, tracks.fps)), source, "test")


def test_fixed_tracks_come_once(two_lamps: LobeTracks) -> None:
    source = FixedSource(two_lamps, "from a file")
    assert source.status() == SourceStatus(3, 3, "from a file", is_finished=True)
    assert source.poll() is two_lamps
    assert source.poll() is None


def test_frames_appear_as_they_are_found_and_the_playhead_stays(two_lamps: LobeTracks) -> None:
    watched = session(Script([None, first(two_lamps, 1), two_lamps]), two_lamps)
    watched.state.playback.go_to(1004)
    watched.update()
    assert watched.state.lobes.count == 0
    for found in (1, 3):
        watched.update()
        tracks = watched.state.tracks
        assert watched.state.playback.frame == 1004
        assert tracks.frames == (1001, 1002, 1004)
        amplitude = tracks.lobes.amplitude
        assert torch.equal(amplitude[:found], two_lamps.lobes.amplitude[:found])
        assert not amplitude[found:].any()
    assert watched.state.tracks is two_lamps


def test_padding_fills_gaps_with_black_lobes_of_a_proper_frame(two_lamps: LobeTracks) -> None:
    tracks = padded(two_lamps, (1001, 1002, 1003, 1004))
    assert tracks.frames == (1001, 1002, 1003, 1004)
    assert torch.equal(tracks.lobes.axes[[0, 1, 3]], two_lamps.lobes.axes)
    assert torch.equal(tracks.lobes.sharpness[[0, 1, 3]], two_lamps.lobes.sharpness)
    assert torch.equal(tracks.lobes.axes[2], torch.eye(3).expand(2, 3, 3))
    assert not tracks.lobes.amplitude[2].any()
    assert tracks.lobes.form is two_lamps.lobes.form


def test_tracks_of_other_frames_are_taken_as_they_are(two_lamps: LobeTracks) -> None:
    assert padded(two_lamps, (1, 2)) is two_lamps
    assert padded(two_lamps, two_lamps.frames) is two_lamps


def test_waiting_ends_with_the_shown_frame(two_lamps: LobeTracks) -> None:
    source = Script([None, first(two_lamps, 1), None, first(two_lamps, 2), two_lamps])
    watched = session(source, two_lamps)
    watched.state.playback.go_to(1002)
    watched.wait()
    assert len(source.news) == 1
    assert bool(watched.state.lobes.amplitude.any())


def test_waiting_for_a_frame_that_never_comes_raises_the_failure(two_lamps: LobeTracks) -> None:
    watched = session(Script([first(two_lamps, 1)], "sky.1002.exr: is damaged."), two_lamps)
    watched.wait()  # 1001, which was found before
    watched.state.playback.go_to(1002)
    with pytest.raises(InputError, match=r"^sky\.1002\.exr: is damaged\.$"):
        watched.wait()


@pytest.mark.parametrize(
    ("failure", "title"), [(None, "Fit"), ("ended", "Fit: none of this frame")]
)
def test_frames_that_a_fit_has_not_come_to_count_as_none_also_when_it_fails(
    two_lamps: LobeTracks, failure: str | None, title: str
) -> None:
    news = [first(two_lamps, 2), None] if failure else [first(two_lamps, 2), None, two_lamps]
    watched = session(Script(news, failure), two_lamps)
    state = watched.state
    watched.update()
    assert state.fitted == {1001, 1002}
    state.playback.go_to_time(1001.5)
    assert state.is_fitted
    state.playback.go_to_time(1003.0)  # between 1002, which is there, and 1004
    assert not state.is_fitted
    assert titles(state)[0] == "Fit: not there yet"
    for _ in range(2):
        watched.update()
    assert not state.is_fitting
    assert state.fitted == ({1001, 1002} if failure else None)
    assert titles(state)[0] == title


@pytest.mark.parametrize("is_fitting", [True, False])
def test_without_lobes_there_are_no_curves_and_it_is_said(
    two_lamps: LobeTracks, is_fitting: bool
) -> None:
    none = no_lobes(two_lamps.frames, two_lamps.fps)
    source = Script([None, two_lamps]) if is_fitting else FixedSource(none)
    watched = Session(ViewerState(none), source, "test")
    watched.update()
    if is_fitting:
        assert without_curves(watched.state) == "The first lobes are being fitted ..."
        watched.update()
        assert without_curves(watched.state) == ""
    else:
        assert without_curves(watched.state) == "No lobes."
        assert said(watched.state, watched) == "no lobes"


def test_what_was_just_done_is_said_also_after_a_fit_has_failed(two_lamps: LobeTracks) -> None:
    watched = session(Script([first(two_lamps, 2)], "sky.1004.exr: is damaged."), two_lamps)
    watched.update()
    assert said(watched.state, watched) == "sky.1004.exr: is damaged."
    watched.state.message = "Saved balls.png."
    assert said(watched.state, watched) == "Saved balls.png."
    watched.state.message = ""
    assert said(watched.state, watched) == "sky.1004.exr: is damaged."


def grey(frame: int) -> np.ndarray:
    return np.full((2, 4, 3), frame, np.float32)


@pytest.mark.parametrize("wait", [Session.wait, lambda session: session.update(1)])
def test_the_reference_follows_the_playhead(
    two_lamps: LobeTracks, wait: Callable[[Session], object]
) -> None:
    reference = Reference("sky", two_lamps.frames, grey, byte_budget=1)  # room for one image
    source = Script([two_lamps])
    watched = Session(ViewerState(two_lamps, reference), source, "test")
    watched.state.playback.go_to(1004)
    wait(watched)
    assert reference.wait(1004, 20.0) is not None
    watched.close()
    assert source.is_closed
    assert reference.get(1004) is None


def test_waiting_for_an_image_that_cannot_be_read_raises_why(two_lamps: LobeTracks) -> None:
    def damaged(frame: int) -> np.ndarray:
        raise InputError(f"sky.{frame}.exr: is damaged; expected an image. Write it anew.")

    reference = Reference("sky", two_lamps.frames, damaged)
    watched = Session(ViewerState(two_lamps, reference), Script([two_lamps]), "test")
    with pytest.raises(InputError, match=r"^sky\.1001\.exr: is damaged; expected an image"):
        watched.wait()
    watched.close()
