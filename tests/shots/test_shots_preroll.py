# SPDX-License-Identifier: Apache-2.0
"""Parts with a preroll: the lobes of one fit of the whole shot."""

from dataclasses import replace
from pathlib import Path

import farm_files
import pytest
import torch

from asglight import read_usd
from asglight.cli.main import main
from asglight.fitting.options import FIT_HEIGHT, FitOptions, Preset
from asglight.images import open_sequence
from asglight.lobes import Lobes
from asglight.shots import ShotResult, fit_shot
from asglight.shots.events import Event, FrameDone, Prerolled
from asglight.shots.parts.joining import join
from asglight.shots.parts.preroll import SETTLING, follow, preroll_frames

LIVE = FitOptions(lobes=3, preset=Preset.LIVE)


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return farm_files.write_shot(tmp_path_factory.mktemp("images") / "sky", range(1001, 1021))


@pytest.fixture(scope="module")
def whole(source: Path, tmp_path_factory: pytest.TempPathFactory) -> ShotResult:
    return fit_shot(source, tmp_path_factory.mktemp("whole") / "x.usda", LIVE)


def same(lobes: Lobes, others: Lobes) -> bool:
    """Tell whether every number is the same to the bit."""
    return all(
        torch.equal(getattr(lobes, name), getattr(others, name))
        for name in ("axes", "sharpness", "amplitude")
    )


@pytest.mark.parametrize("first", [1001, 1002, 1001 + SETTLING, 1012])
def test_a_live_part_is_the_fit_of_the_whole_shot_to_the_bit(
    source: Path, whole: ShotResult, first: int, tmp_path: Path
) -> None:
    events: list[Event] = []
    part = fit_shot(
        source,
        tmp_path / "x.usda",
        replace(LIVE, preroll=1001),
        frames=f"{first}-{first + 2}",
        on_progress=events.append,
    )
    for record in part.records:
        assert same(record.lobes, whole.records[record.frame - 1001].lobes)
    told = [event for event in events if isinstance(event, Prerolled)]
    assert [event.done for event in told] == list(range(1, first - 1000))
    assert {event.frames for event in told} <= {first - 1001}
    assert read_usd(tmp_path / "x.usda").metadata["preroll"] == 1001


def test_parts_of_a_fast_shot_are_one_set_of_lobes(source: Path, tmp_path: Path) -> None:
    """`fast` parts err differently, but each lobe goes on at the seam as itself."""
    options, files = replace(LIVE, preset=Preset.FAST, preroll=1001), []
    for frames in ("1001-1013", "1010-1020"):
        files.append(str(tmp_path / f"part.{frames}.usdc"))
        fit_shot(source, files[-1], options, frames=frames)
    before, after = (read_usd(file).lobes for file in files)
    joined = join(files, str(tmp_path / "shot.usdc")).tracks
    assert joined.lobes.count == 3
    cosine = before.axis_z[-4:] @ after.axis_z[:4].mT  # a part has its own order, by energy
    assert cosine.amax(-1).min() > 0.98  # 11 degrees: other lamps are 40 and more away
    # before the overlap they are those of the first part, made orthonormal once more
    assert torch.allclose(joined.lobes.axes[:9], before.axes[:9], atol=1e-6)


@pytest.fixture(scope="module")
def unbroken(source: Path, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """Return the stage of a part."""
    stage = tmp_path_factory.mktemp("unbroken") / "x.usdc"
    fit_shot(source, stage, replace(LIVE, preroll=1001), frames="1012-1015")
    return stage.read_bytes()


@pytest.mark.parametrize("kept", [1, 2])
def test_a_resumed_part_is_the_unbroken_one_byte_for_byte(
    source: Path, unbroken: bytes, tmp_path: Path, kept: int
) -> None:
    options, frames = replace(LIVE, preroll=1001), "1012-1015"

    def stop(event: Event) -> None:
        if isinstance(event, FrameDone) and event.position == kept:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fit_shot(source, tmp_path / "x.usdc", options, frames=frames, on_progress=stop)
    events: list[Event] = []
    fit_shot(
        source,
        tmp_path / "x.usdc",
        options,
        frames=frames,
        resume=True,
        on_progress=events.append,
    )
    # two frames are enough to go on from
    assert any(isinstance(event, Prerolled) for event in events) == (kept == 1)
    assert (tmp_path / "x.usdc").read_bytes() == unbroken


def test_stretches_that_are_handed_on_are_one_preroll(source: Path) -> None:
    options = replace(LIVE, preset=Preset.FAST, preroll=1001).settled(2)
    near, far = (
        open_sequence(source, frames=frames, height=FIT_HEIGHT)
        for frames in ("1012-1014", "1017-1020")
    )
    at_once = follow(far, options, None)
    handed = follow(far, options, follow(near, options, None))
    assert at_once is not None
    assert handed is not None
    assert at_once.frame == handed.frame == 1016 - SETTLING
    assert all(map(same, at_once.lobes, handed.lobes))


@pytest.mark.parametrize(
    ("frames", "first", "expected"),
    [
        ((1005, 1006), 1001, [1001, 1002, 1003, 1004]),
        ((1005, 1007, 1009), 1001, [1001, 1003]),
        ((1006, 1008), 1001, [1002, 1004]),
        ((1005,), 1003, [1003, 1004]),
        ((1001, 1002), 1001, []),
        ((1005, 1006), None, []),
    ],
)
def test_the_frames_of_a_preroll_keep_the_step(
    frames: tuple[int, ...], first: int | None, expected: list[int]
) -> None:
    assert preroll_frames(frames, first) == expected


FAULTS = [
    ("--frames 1005-1008 --preroll 1006", "preroll: 1006; expected 1005, the first frame to fit"),
    ("--frames 1005-1008 --preroll 1001 --preset paper", "preroll: 1001 with --preset paper"),
    ("--frames 1005-1008 --preroll 1001 --tolerance 0.1", "preroll: 1001 with a tolerance"),
    ("--frames 1005-1008 --preroll 990", "sky: 11 frames missing (990-1000); expected every"),
]


@pytest.mark.parametrize(("words", "message"), FAULTS)
def test_a_fault_is_one_line(
    words: str, message: str, source: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["fit", str(source), "-o", str(tmp_path / "x.usda"), *words.split()]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert message in line
    assert list(tmp_path.iterdir()) == []
