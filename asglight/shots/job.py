# SPDX-License-Identifier: Apache-2.0
"""A shot as a job: read, fit, checkpoint, resume, write.

`fit_shot` is what a farm runs. Whatever ends it, the output is either the old file or the complete
new one, and the frames fitted so far are kept beside it (checkpoint.py). `fit_sequence` is the same
fit in memory.
"""

import importlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from asglight.errors import InputError
from asglight.fitting.options import FIT_HEIGHT, FORM_NAMES, FitOptions, Preset, form_of
from asglight.images import Sequence, ocio, open_sequence
from asglight.images.account import read_as, warning_lines
from asglight.images.message import shown
from asglight.images.options import LOST_MAX, Eye, ReadOptions
from asglight.images.output import check_names_file
from asglight.images.sequence import Missing
from asglight.lobes import Form, LobeTracks
from asglight.lobes.data import check_frames
from asglight.lobes.identity.naming import named_as
from asglight.shots.conditioning import with_condition
from asglight.shots.events import Event, FrameDone, Notice, OnProgress, ignore
from asglight.shots.kept.checkpoint import SUFFIX, Checkpoint, header_of
from asglight.shots.kept.kept_frames import SUFFIX as FRAMES_SUFFIX
from asglight.shots.kept.kept_frames import KeptFrames
from asglight.shots.kept.records import FrameRecord
from asglight.shots.parts.preroll import Followed, check_preroll
from asglight.shots.reading import stamp_of
from asglight.shots.rounds import InMemory, fitted_shot, is_read_again
from asglight.shots.settings import (
    check_fps,
    check_options,
    check_output,
    settings_of,
)
from asglight.shots.tracks import tracks_from
from asglight.threads import one_thread
from asglight.usd.options import (
    KeyOptions,
    StageOptions,
    check_key_options,
    check_stage_options,
    stages_beside,
)

if TYPE_CHECKING:
    from asglight.usd import WriteReport
    from asglight.usd.write.keys import KeySource

Earlier = Callable[[], LobeTracks | InputError | None]
"""Gives the stage whose names are kept, None where there is none, or why it cannot be read."""


@dataclass(frozen=True)
class ShotResult:
    """A finished shot.

    Attributes:
        tracks: The lobes, as written.
        records: Every frame with its loss, repair and time.
        resumed: How many frames came from an earlier run.
        written: What was written.
        representations: What the lobes were written as.
        colorspace: That of the stage's colours, by its name in the config of OpenColorIO.
        keys: What is told of its keys, as JSON values; None where there are none.
    """

    tracks: LobeTracks
    records: tuple[FrameRecord, ...]
    resumed: int
    written: "WriteReport"
    representations: tuple[str, ...]
    colorspace: str
    keys: dict[str, Any] | None = None


def fit_shot(
    source: str | Path,
    output: str | Path,
    options: FitOptions = FitOptions(),  # noqa: B008  frozen, so one default serves all calls
    *,
    frames: str | None = None,
    fps: float = 24.0,
    missing: Missing = "error",
    reading: ReadOptions = ReadOptions(),  # noqa: B008  frozen as well
    stage: StageOptions = StageOptions(),  # noqa: B008  frozen as well
    keys: KeyOptions | None = None,
    names_from: str | Path | None = None,
    resume: bool = False,
    on_progress: OnProgress = ignore,
    followed: Followed | None = None,
) -> ShotResult:
    """Fit a sequence and write it as a USD stage.

    Each finished frame is saved in `<output>.checkpoint`, which is deleted when the stage is
    written. With `resume` a run takes up the checkpoint of one that was interrupted and writes the
    same bytes as an unbroken run; where there is no checkpoint it starts at the first frame, so a
    farm can always ask for it. Without `resume` a run starts afresh and says that it does.

    Args:
        source: A file, a folder, or a pattern such as `sky.####.exr`.
        output: The stage: .usda, .usdc, .usd or .usdz.
        options: Settings of the fit.
        frames: Frames to use, such as `1001-1048`; None for all.
        fps: Frames per second.
        missing: `error`, or what stands in for a missing or damaged frame: `hold` or `interpolate`.
        reading: How the images are read.
        stage: How the stage is written.
        keys: How keys are found, of a stage that shows them; None for none.
        names_from: A stage of an earlier fit, whose names its lights keep; None for the one that
            is written anew, if there is one.
        resume: Go on from the checkpoint, if there is one.
        on_progress: Called with each event.
        followed: With a preroll, where it has been already (preroll.py).

    Raises:
        InputError: The input, a setting or the output cannot be used; or another run writes it.
    """
    check_names_file(output)
    output = Path(output)
    _check(options, fps, output, stage, keys)
    earlier = _named_stage(output, names_from)
    sequence = open_sequence(
        source, frames=frames, missing=missing, height=FIT_HEIGHT, reading=reading
    )
    check_frames(sequence.frames)
    check_preroll(options, sequence.frames[0])
    keying = keys and _keying(source, frames, missing, reading, keys)
    options = options.settled(len(sequence.frames))
    for warning in warning_lines(read_as(sequence.model)):
        on_progress(Notice(f"{shown(sequence.pattern)}: {warning}"))
    with _kept_beside(output, sequence, options, fps, resume) as (checkpoint, images):
        _check_unchanged(sequence, checkpoint)
        _tell_state(checkpoint, on_progress)
        told = _loading_usd(on_progress, earlier)
        shot = fitted_shot(sequence, options, checkpoint, images, told, followed)
        with one_thread():  # numbers so small that threads of torch would wait for each other
            tracks = tracks_from(shot.records, sequence, shot.options, fps, shot.accuracy)
            tracks = with_condition(_named(tracks, earlier(), on_progress))
            written = write_stage(tracks, output, stage, keying and keying(on_progress))
    held, space = stage.representations, ocio.NAMES[ocio.interop_id(stage.colorspace)]
    records = tuple(shot.records)
    return ShotResult(tracks, records, shot.resumed, written, held, space, written.keys)


def _loading_usd(on_progress: OnProgress, earlier: Earlier) -> OnProgress:
    """Load what writes the stage, and read the earlier one, when the first frame is there.

    The next are decoded meanwhile, and nothing of it is left for the end.
    """

    def told(event: Event) -> None:
        """Tell the caller first."""
        on_progress(event)
        if isinstance(event, FrameDone):
            # not in a thread beside the fit: pxr that loads while another library does can lock up
            importlib.import_module("asglight.usd.write.stage_file")
            if earlier() is not None:
                importlib.import_module("scipy.optimize")  # for the names (naming.py)

    return told


def _check(
    options: FitOptions, fps: float, output: Path, stage: StageOptions, keys: KeyOptions | None
) -> None:
    """Refuse settings that cannot be used, before anything is read."""
    check_options(options)
    check_fps(fps)
    check_output(output)
    check_stage_options(stage)
    if stage.may_show_images and stages_beside(output):
        from asglight.usd.write.checks import check_images_apart

        check_images_apart(output)
    if keys is not None:
        check_key_options(keys)


@contextmanager
def _kept_beside(
    output: Path, sequence: Sequence, options: FitOptions, fps: float, resume: bool
) -> Iterator[tuple[Checkpoint, KeptFrames]]:
    """Give what is kept beside the output; it is removed when the stage was written."""
    header = header_of(settings_of(sequence, options, fps))
    path = output.with_name(output.name + SUFFIX)
    frames_path = output.with_name(output.name + FRAMES_SUFFIX)
    is_needed = is_read_again(options)
    with (
        Checkpoint(path, header, resume=resume) as checkpoint,  # it is locked before
        KeptFrames(
            sequence, frames_path, is_needed=is_needed, header=header, resume=resume
        ) as images,
    ):
        yield checkpoint, images
        images.remove()
        checkpoint.remove()


def fit_sequence(
    source: str | Path,
    *,
    lobes: int | None = None,
    preset: str = Preset.FAST,
    form: str = Form.ASG,
    seed: int = 0,
    device: str = "cpu",
    frames: str | None = None,
    fps: float = 24.0,
    missing: Missing = "error",
    layer: str | None = None,
    eye: Eye | None = None,
    input_colorspace: str | None = None,
    repair: float = LOST_MAX,
    tolerance: float | None = None,
    max_lobes: int | None = None,
    on_progress: OnProgress = ignore,
) -> LobeTracks:
    """Fit lobes to a latlong image or sequence.

    Examples:
        >>> tracks = asglight.fit_sequence("sky.####.exr", lobes=2, frames="1001-1002")
        >>> tracks.frames
        (1001, 1002)

    Args:
        source: A file, a folder, or a pattern such as `sky.####.exr`.
        lobes: Number of lobes, at most (None: 15); those that the shot does not need are left out.
        preset: How the fit is made: a value of `asglight.fitting.options.Preset`.
        form: Lobe function: `asg`, `bingham`, `sg` or `flat`; `auto` lets `fast` and `best` take
            `flat` or `sg` in place of `asg` for a still that it shows better.
        seed: Of the presets that draw random numbers.
        device: Where torch computes: `cpu`, `cuda`, `cuda:1`.
        frames: Frames to use, such as `1001-1048`; None for all.
        fps: Frames per second.
        missing: `error`, or what stands in for a missing or damaged frame: `hold` or `interpolate`.
        layer: Layer or part of OpenEXR files; None for the beauty.
        eye: Eye of stereo images: `left` or `right`.
        input_colorspace: Space of the colours, whatever the images state; None for what they do.
        repair: Share of a frame's light or texels that may be lost to values that are no light.
        tolerance: In place of `lobes`: the fewest with which irr and r0.5 of every frame stay at or
            below this.
        max_lobes: With a tolerance, lobes at most (None: 30).
        on_progress: Called with each event of `asglight.shots.events`.

    Raises:
        InputError: The input or a setting cannot be used.
    """
    options = FitOptions(
        lobes,
        preset_named(preset),
        form_named(form),
        seed,
        device,
        tolerance=tolerance,
        max_lobes=max_lobes,
    )
    check_options(options)
    check_fps(fps)
    reading = ReadOptions(layer, eye, input_colorspace, repair)
    sequence = open_sequence(
        source, frames=frames, missing=missing, height=FIT_HEIGHT, reading=reading
    )
    options = options.settled(len(sequence.frames))
    with KeptFrames(sequence, is_needed=is_read_again(options)) as images:
        shot = fitted_shot(sequence, options, InMemory(), images, on_progress)
    return with_condition(tracks_from(shot.records, sequence, shot.options, fps, shot.accuracy))


def write_stage(
    tracks: LobeTracks,
    output: str | Path,
    options: StageOptions,
    keys: "KeySource | None" = None,
) -> "WriteReport":
    """Write tracks with options; loads pxr, which nothing else of a fit needs."""
    from asglight.usd import write_usd

    return write_usd(tracks, output, **vars(options), keys=keys)


def _keying(
    source: str | Path,
    frames: str | None,
    missing: Missing,
    reading: ReadOptions,
    options: KeyOptions,
) -> "Callable[[OnProgress], KeySource]":
    """Return what makes the source of keys when the lobes are there; it loads what they need."""

    def made(on_progress: OnProgress) -> "KeySource":
        """Return the source of keys, which tells how far it is."""
        from asglight.shots.keying import Keying, following_events

        height = options.rest_height
        sequence = open_sequence(
            source, frames=frames, missing=missing, height=height, reading=reading
        )
        return Keying(sequence, options, following_events(on_progress))

    return made


def _named_stage(output: Path, names_from: str | Path | None) -> Earlier:
    """Return what gives the stage whose names are kept.

    The one that was asked for is read at once. One that is merely in the way may be anything, and
    is read once, when it is first asked for.

    Raises:
        InputError: The stage that was asked for cannot be read.
    """
    if names_from is not None:
        from asglight.usd import read_usd

        asked = read_usd(names_from)
        return lambda: asked
    if not output.exists():
        return lambda: None
    return cache(lambda: _read(output))


def _read(stage: Path) -> LobeTracks | InputError:
    """Read a stage; return why it cannot be read."""
    from asglight.usd import read_usd

    try:
        return read_usd(stage)
    except InputError as error:
        return error


def _named(
    tracks: LobeTracks, earlier: LobeTracks | InputError | None, on_progress: OnProgress
) -> LobeTracks:
    """Return tracks with the names of an earlier stage, if it could be read."""
    if isinstance(earlier, InputError):
        on_progress(Notice(f"{earlier} Lights are named anew"))
        return tracks
    return tracks if earlier is None else named_as(tracks, earlier)


def _check_unchanged(sequence: Sequence, checkpoint: Checkpoint) -> None:
    """Refuse to mix frames fitted to other images."""
    for record in checkpoint.records:
        if stamp_of(sequence, record.frame) != record.stamp:
            raise InputError(
                f"{shown(sequence.path(record.frame))}: has changed since frame {record.frame} was "
                f"fitted; expected the same image. Delete {shown(checkpoint.path)} or leave out "
                "--resume to start afresh."
            )


def _tell_state(checkpoint: Checkpoint, on_progress: OnProgress) -> None:
    name = shown(checkpoint.path)
    if checkpoint.left_aside:
        frames = f"{checkpoint.left_aside} {'frame' if checkpoint.left_aside == 1 else 'frames'}"
        on_progress(
            Notice(f"{name}: {frames} of an earlier run not used; --resume would go on from there")
        )
    if not checkpoint.is_locked:
        on_progress(
            Notice(f"{name}: cannot be locked on this file system; start no second run on it")
        )


def preset_named(name: str) -> Preset:
    """Return a preset by its name.

    Raises:
        InputError: There is none of that name.
    """
    if name not in list(Preset):
        raise InputError(f"preset: {shown(name)}; expected one of {', '.join(Preset)}.")
    return Preset(name)


def form_named(name: str) -> Form | None:
    """Return a form by its name; None for `auto`.

    Raises:
        InputError: There is none of that name.
    """
    if name not in FORM_NAMES:
        raise InputError(f"form: {shown(name)}; expected one of {', '.join(FORM_NAMES)}.")
    return form_of(name)
