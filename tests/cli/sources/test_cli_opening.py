# SPDX-License-Identifier: Apache-2.0
"""What `asglight view` opens, and what it refuses."""

from collections.abc import Callable, Iterator
from pathlib import Path

import loaded
import numpy as np
import processes
import pytest
import shot_files
import sky_files
import torch
import written_stages

from asglight.cli.sources import built_in, live_source
from asglight.cli.sources.live_source import LiveSource
from asglight.cli.sources.opening import Request, opened, stage_of
from asglight.errors import InputError
from asglight.images.options import ReadOptions
from asglight.lobes import LobeTracks
from asglight.lobes.data import stack
from asglight.viewer.state.session import Session

FRAMES = (1001, 1002, 1003, 1004)

Open = Callable[..., Session]


@pytest.fixture
def start(monkeypatch: pytest.MonkeyPatch) -> Iterator[Open]:
    """Return a function that opens a request; what runs is ended after the test.

    The process of a fit is a fork that need not load torch.
    """
    monkeypatch.setattr(live_source.multiprocessing, "get_context", loaded.context)
    sessions: list[Session] = []

    def started(**request: object) -> Session:
        sessions.append(opened(Request(**request)))  # type: ignore[arg-type]
        return sessions[-1]

    yield started
    for session in sessions:
        session.close()


@pytest.fixture
def images(tmp_path: Path) -> Path:
    return sky_files.write_sequence(tmp_path / "in")


@pytest.fixture
def stage(tmp_path: Path) -> Path:
    (tmp_path / "out").mkdir()
    path = tmp_path / "out" / "shot.usda"
    written_stages.put(LobeTracks(FRAMES, 25.0, stack([shot_files.lobes(k) for k in FRAMES])), path)
    return path


@pytest.mark.parametrize("named", ["out/shot.usda", "out"])
def test_a_stage_is_opened_by_its_name_or_its_folder(
    start: Open, stage: Path, tmp_path: Path, named: str
) -> None:
    session = start(input=str(tmp_path / named))
    assert session.title == "shot.usda"
    assert session.state.tracks.frames == FRAMES
    assert session.state.tracks.fps == 25.0
    assert session.state.references is None
    assert session.update().is_finished


def test_one_image_of_a_sequence_as_reference_is_the_sequence_of_the_shot(
    start: Open, stage: Path, images: Path
) -> None:
    one = next(path for path in sorted(images.iterdir()) if "1002" in path.name)
    references = start(input=str(stage), reference=str(one)).state.references
    assert references is not None
    assert len(set(references.frames) & set(FRAMES)) > 1


def test_a_folder_with_a_stage_and_images_is_the_stage(images: Path, stage: Path) -> None:
    assert stage_of(images) is None
    stage.rename(images / "shot.usda")
    assert stage_of(images) == images / "shot.usda"
    (images / ".hidden.usda").touch()
    assert stage_of(images) == images / "shot.usda"
    (images / "other.usdc").touch()
    with pytest.raises(InputError, match=r"in: holds 2 stages \(other\.usdc, shot\.usda\); expect"):
        stage_of(images)


def test_a_stage_has_its_reference_beside_it(start: Open, images: Path, stage: Path) -> None:
    session = start(input=str(stage), reference=str(images), frames="1002-1004")
    assert session.state.references is not None
    assert session.state.references.frames == (1002, 1003, 1004)
    session.state.playback.go_to(1003)
    session.wait()
    image = session.state.references.get(1003)
    assert image is not None
    assert np.array_equal(image, sky_files.sky(1003))


def test_images_alone_are_shown_without_lobes(start: Open, images: Path) -> None:
    (images / "sky.1002.exr").unlink()
    session = start(input=str(images))
    assert session.state.tracks.frames == FRAMES  # the missing one too
    assert session.state.lobes.count == 0
    assert session.state.references is not None
    status = session.update()
    assert status.is_finished
    assert status.message == (
        "sky: shown without lobes: --live fits them now, asglight fit -o STAGE keeps them"
    )


def test_images_are_fitted_live(start: Open, images: Path) -> None:
    (images / "sky.1002.exr").unlink()  # the frame before stands in for it
    session = start(input=str(images), live=True, lobes=4)
    assert session.state.tracks.frames == FRAMES
    processes.wait_until(lambda: session.update().is_finished)
    status = session.update()
    assert (status.failure, status.frames_done) == (None, 4)
    amplitude = session.state.tracks.lobes.amplitude
    assert bool((amplitude > 0).any(-1).any(-1).all())
    assert torch.equal(amplitude[0], amplitude[1])


def test_nothing_given_is_the_built_in_environment_and_its_fit(
    start: Open, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(built_in, "HEIGHT", 16)  # of what is drawn here, ahead of the fit
    session = start(lobes=3)
    assert session.title == "built-in environment"
    assert session.state.tracks.frames == built_in.FRAMES
    assert session.state.references is not None
    session.wait()
    image = session.state.references.get(1001)
    assert image is not None
    assert image.shape == (16, 32, 3)
    assert session.state.lobes.count == 6  # two tracks for each lobe
    assert isinstance(session.source, LiveSource)
    pid = session.source.process.pid
    assert pid is not None
    session.close()  # in the middle of the fit
    assert not processes.is_running(pid)


@pytest.mark.parametrize(
    ("request_of", "message"),
    [
        ({"input": "shot.usda", "live": True}, "--live: given with the stage shot.usda, whose"),
        ({"input": "in", "reference": "in"}, "--reference: given without a stage to compare with"),
        ({"reference": "in"}, "To see only the images: asglight view in."),
        ({"input": "in", "lobes": 3}, "--lobes: given without --live; expected both or neither."),
        ({"input": "in", "live": True, "lobes": 0}, "--lobes: 0; expected 1 to 128."),
        ({"lobes": 129}, "--lobes: 129; expected 1 to 128."),
        ({"frames": "1-2"}, "--frames: given without images to choose from; expected them as"),
        (
            {"input": "shot.usda", "reading": ReadOptions(layer="a")},
            "--layer: given without images to choose from;",
        ),
        (
            {"reading": ReadOptions(colorspace="ACEScg")},
            "--input-colorspace: given without images to choose",
        ),
        ({"input": "nowhere.usda"}, "nowhere.usda"),
        ({"input": "nowhere.exr", "live": True}, "nowhere.exr: is not there; expected a file"),
    ],
)
def test_a_request_that_contradicts_itself_is_explained(
    images: Path,
    stage: Path,
    monkeypatch: pytest.MonkeyPatch,
    request_of: dict[str, object],
    message: str,
) -> None:
    monkeypatch.chdir(images.parent)
    with pytest.raises(InputError) as error:
        opened(Request(**request_of))  # type: ignore[arg-type]
    assert message in str(error.value)


def test_a_reference_that_cannot_be_opened_ends_the_watch(stage: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="nowhere"):
        opened(Request(str(stage), reference=str(tmp_path / "nowhere.exr")))
