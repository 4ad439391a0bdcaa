# SPDX-License-Identifier: Apache-2.0
"""What the viewer shows: plain data, the single truth of a session. No OpenGL, no window."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from enum import Enum, StrEnum, auto
from functools import lru_cache
from typing import Literal

import numpy as np
import torch

from asglight.errors import InputError
from asglight.lobes import Form, Lobes, LobeTracks, asg, flat, motion
from asglight.viewer.reference.images import Reference
from asglight.viewer.reference.rest import Keyed, flux_of
from asglight.viewer.state.balls import WHITE, Ball, Material, Rgb, ball_row
from asglight.viewer.state.camera import Camera
from asglight.viewer.state.display import (
    EXPOSURE_EV_STEP,
    LUMINANCE,
    MIDDLE_GREY,
    Comparison,
    Display,
    Subject,
)
from asglight.viewer.state.editing import Editing
from asglight.viewer.state.edits import EditHistory, toggle_mute
from asglight.viewer.state.held import Held
from asglight.viewer.state.picking import energies
from asglight.viewer.state.playback import Playback
from asglight.viewer.state.time_span import TimeSpan

MAX_LOBES = 128
"""Lobes in a frame: 8 KiB of the 16 KiB that every OpenGL has for a uniform block."""

SHEETS_MAX = 2 * MAX_LOBES
"""Of all lobes together (shading/sheets.py): two of each of the bingham form, three of the flat."""

INTENSITY_EV_MAX = 10.0
"""Stops by which the environment can be made brighter or darker."""


def lobes_max(form: Form) -> int:
    """Return how many lobes of a form the viewer holds."""
    return SHEETS_MAX // len(flat.TERMS) if form is Form.FLAT else MAX_LOBES


class Request(Enum):
    """What only the window can do; it empties the list after every picture."""

    OPEN = auto()
    SAVE_EDITS = auto()
    SAVE_PICTURE = auto()
    RENDER = auto()
    RENDER_LABELLED = auto()
    RENDER_TURNTABLE = auto()
    QUIT = auto()


RENDERS = (Request.RENDER, Request.RENDER_LABELLED, Request.RENDER_TURNTABLE)


class Theme(StrEnum):
    """Colours of the window around the pictures."""

    DARK = "dark"
    LIGHT = "light"


class Outlines(StrEnum):
    """Which lobes are drawn over the map."""

    ALL = "all outlines"
    SELECTED = "selected only"
    NONE = "no outlines"


@dataclass
class Environment:
    """The environment around the balls.

    Attributes:
        intensity_ev: Stops added to all of its radiance.
        is_shown: Whether it is seen behind the balls.
    """

    intensity_ev: float = 0.0
    is_shown: bool = False


@dataclass
class Selection:
    """Which lobes are looked at: a matter of the view; muting is an edit (edits.py).

    Attributes:
        lobe: Index of the selected one.
        solo: While there are any, only these light.
        is_new: Whether the list has not shown it yet.
    """

    lobe: int | None = None
    solo: set[int] = field(default_factory=set)
    is_new: bool = False


@dataclass
class Compared:
    """What is shown of the fit and its reference.

    Attributes:
        comparison: Which of both.
        subject: What counts as fit and as reference.
        wipe: Share of the columns left of the wipe.
        is_flipped: Whether a held key shows the other one.
    """

    comparison: Comparison = Comparison.FIT
    subject: Subject = Subject.TOTAL
    wipe: float = 0.5
    is_flipped: bool = False

    @property
    def shown(self) -> Comparison:
        """What is shown now: while flipped, the reference; the fit where that is shown already."""
        if not self.is_flipped:
            return self.comparison
        is_reference = self.comparison is Comparison.REFERENCE
        return Comparison.FIT if is_reference else Comparison.REFERENCE


@dataclass(frozen=True)
class Probe:
    """Where numbers are read.

    Attributes:
        place: The map, or the balls.
        x: Share of the picture's columns from the left.
        y: Share of its rows from the top; of one row of balls.
    """

    place: Literal["map", "balls"]
    x: float
    y: float


@dataclass(frozen=True)
class Inspected:
    """What lies under the pointer.

    Attributes:
        place: Where: the map, or a ball's name.
        direction: In the environment's coordinates; on a ball, what a mirror would show.  [3]
        fit: Radiance of what is shown as fit.  [3]
        reference: Of what is shown as reference, where there is one.  [3]
        shares: Indices of the lobes that send light from the direction, and their share of its
            luminance, the largest first.
    """

    place: str
    direction: np.ndarray
    fit: np.ndarray | None
    reference: np.ndarray | None
    shares: list[tuple[int, float]]


@lru_cache(maxsize=4)
def shown_lobes(tracks: Held[LobeTracks], index: int, part: float) -> Lobes:
    """Return the lobes of a frame, or between it and the next one.  [N, .].

    Args:
        tracks: The shot.
        index: Place of the frame.
        part: How far to the next one (lobes/motion.py has the rule).
    """
    if not part:
        return tracks.value.lobes[index]
    pair = slice(index, index + 2)
    frames, lobes = tracks.value.frames[pair], tracks.value.lobes[pair]
    time = frames[0] + part * (frames[1] - frames[0])
    return motion.at(replace(tracks.value, frames=frames, lobes=lobes), [time])[0].to(torch.float32)


@lru_cache(maxsize=2)
def dissolved(first: Held[np.ndarray], last: Held[np.ndarray], part: float) -> np.ndarray:
    """Return two images mixed, float32 [H, W, 3]."""
    return ((1 - part) * first.value + part * last.value).astype(np.float32)


class ViewerState:
    """A session of the viewer.

    Attributes:
        history: The tracks with their edits.
        playback: The playhead.
        span: The part of the shot that the timeline shows.
        keyed: What a stage shows beside its keys, which its tracks are then; None of other stages.
        references: Images of the same frames to compare with, or None.
        display: How radiance is shown.
        camera: Where the balls are seen from.
        environment: What is around them.
        compared: What the balls show of fit and reference.
        map_view: What the map shows of them.
        selection: Which lobes are looked at and which light.
        material: What the balls are made of.
        base_colour: Their colour, linear RGB.
        is_dragging: Whether the mouse changes something at this moment.
        has_panels: Whether the panels are shown beside the balls.
        theme: Colours of the window.
        outlines: Which lobes are drawn over the map.
        has_help: Whether the list of keys is shown.
        message: One line about what was done or went wrong last.
        inspected: What the pointer was over last, in the frame that is shown.
        probe: Where that is.
        fitted: Frames whose lobes are known; None for all.
        is_fitting: Whether more lobes will come.
        editing: Where the sliders of the selected lobe stand.
        moves_wipe: Whether the drag that goes on began on the wipe line.
        requests: What the window is to do.
    """

    def __init__(
        self,
        tracks: LobeTracks,
        references: Reference | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Show tracks from their first frame on.

        Args:
            tracks: At least one frame.
            references: Images to compare with.
            clock: Seconds on a steady clock, for playing.

        Raises:
            InputError: There are more lobes than `lobes_max`.
        """
        self.clock = clock
        self.display = Display()
        self.camera = Camera()
        self.environment = Environment()
        self.compared = Compared()
        self.map_view = Compared()
        self.material = Material.METAL
        self.base_colour: Rgb = WHITE
        self.is_dragging = False
        self.has_panels = True
        self.theme = Theme.DARK
        self.outlines = Outlines.ALL
        self.has_help = False
        self.message = ""
        self.editing = Editing()
        self.moves_wipe = False
        self.inspected: Inspected | None = None
        self.probe: Probe | None = None
        self.fitted: frozenset[int] | None = None
        self.is_fitting = False
        self.requests: list[Request] = []
        self.keyed: Keyed | None = None
        self.references: Reference | None = None
        self.open(tracks, references)

    def open(self, tracks: LobeTracks, references: Reference | None = None) -> None:
        """Show other tracks; camera, display and environment stay as they are.

        Raises:
            InputError: There are more lobes than `lobes_max`.
        """
        most = lobes_max(tracks.lobes.form)
        if tracks.lobes.count > most:
            raise InputError(
                f"tracks: {tracks.lobes.count} lobes; expected at most {most}, which is "
                "what the viewer holds. Fit fewer with --lobes."
            )
        self.history = EditHistory(tracks)
        self.playback = Playback(tracks.frames, tracks.fps)
        self.span = TimeSpan(tracks.frames[0], tracks.frames[-1] + 1)
        self.selection = Selection(self._brightest())
        self.compare_with(references)

    def compare_with(self, references: Reference | None) -> None:
        """Compare with the images of another sequence, or with none."""
        if self.references is not None:
            self.references.close()
        self.references = references
        self.compared.comparison = Comparison.ROWS if references else Comparison.FIT
        self.map_view.comparison = Comparison.REFERENCE if references else Comparison.FIT

    def replace_tracks(self, tracks: LobeTracks) -> None:
        """Take over newer lobes, with the edits that were made to the older ones."""
        had_lobes = self.tracks.lobes.count > 0
        self.history = self.history.over(tracks)
        if not had_lobes:
            self.select(self._brightest())
        if tracks.frames != self.playback.frames:
            frame = self.playback.frame
            self.span = TimeSpan(tracks.frames[0], tracks.frames[-1] + 1)
            self.playback = Playback(tracks.frames, tracks.fps)
            self.playback.go_to(frame)

    @property
    def tracks(self) -> LobeTracks:
        """The tracks as they are shown, with their edits."""
        return self.history.tracks

    @property
    def lobe_names(self) -> tuple[str, ...]:
        """What the lobes are called, as in the stage."""
        return self.tracks.names

    @property
    def lobes(self) -> Lobes:
        """All lobes of the shown time.  [N, .]."""
        return shown_lobes(Held(self.tracks), self.playback.index, self.playback.part)

    @property
    def fitted_lobes(self) -> Lobes:
        """All lobes of the shown frame as they were before any edit.  [N, .]."""
        return self.history.original.lobes[self.playback.index]

    @property
    def is_fitted(self) -> bool:
        """Whether the shown frame has its lobes."""
        has_light = self.tracks.lobes.count > 0 or self.keyed is not None
        return has_light and (self.fitted is None or self.playback.frame in self.fitted)

    @property
    def lit(self) -> tuple[int, ...]:
        """Indices of the lobes that light: neither muted nor outside a solo."""
        lobes, solo = range(self.tracks.lobes.count), self.selection.solo
        muted = self.history.muted
        return tuple(n for n in lobes if n not in muted and (not solo or n in solo))

    def lights(self, lobe: int) -> bool:
        """Tell whether a lobe takes part."""
        return lobe in self.lit

    def toggle_mute(self, lobe: int) -> None:
        """Mute a lobe, or let it light again: an edit as any other."""
        self.history.commit()
        self.history.add(toggle_mute(lobe))

    @property
    def lit_lobes(self) -> Lobes:
        """The lobes that light the shown frame.  [L, .]."""
        return self.lobes.select(torch.tensor(self.lit, dtype=torch.long))

    @property
    def balls(self) -> tuple[Ball, ...]:
        """The row of balls."""
        return ball_row(self.material, self.base_colour)

    @property
    def is_moving(self) -> bool:
        """Whether the picture changes on its own or under the mouse: then it has to be quick."""
        return self.is_dragging or self.playback.is_playing

    @property
    def shown(self) -> Comparison:
        """What the balls show: without a reference the fit, without any lobe the reference."""
        return self._shown(self.compared)

    @property
    def shown_map(self) -> Comparison:
        """What the map shows of them."""
        return self._shown(self.map_view)

    def _shown(self, compared: Compared) -> Comparison:
        if self.references is None:
            return Comparison.FIT
        has_light = self.tracks.lobes.count or self.keyed is not None
        return compared.shown if has_light else Comparison.REFERENCE

    @property
    def reference_image(self) -> np.ndarray | None:
        """The reference of the shown time, if it is in memory.  [H, W, 3].

        Between two frames it is the one dissolved into the other: a picture, not a light that was.
        """
        return None if self.references is None else self._image(self.references)

    @property
    def rest_image(self) -> np.ndarray | None:
        """What lights beside the keys at the shown time, likewise.  [H, W, 3]."""
        return None if self.keyed is None else self._image(self.keyed.rest)

    def _image(self, images: Reference) -> np.ndarray | None:
        playback = self.playback
        image = images.get(playback.frame)
        if not playback.is_between or image is None or images.is_still:
            return image
        following = images.get(playback.next_frame)
        if following is None or following.shape != image.shape:
            return None
        return dissolved(Held(image), Held(following), playback.part)

    @property
    def reference_label(self) -> str:
        """What the reference shows where that is not the image of the shown frame; else empty."""
        if self.references is None:
            return ""
        playback = self.playback
        if playback.is_between and not self.references.is_still:
            return f"{playback.frame} dissolved into {playback.next_frame}"
        return self.references.label(playback.frame)

    def meter(self) -> bool:
        """Expose so that the mean radiance of the light is middle grey, in steps of a key.

        Returns:
            Whether there was light to meter, that of the rest included.
        """
        lobes, rest = self.lit_lobes, self.rest_image
        if self.keyed is not None and rest is None:
            return False
        flux = asg.flux(lobes).sum(0) + (0.0 if rest is None else flux_of(rest))
        mean = float(flux @ torch.tensor(LUMINANCE)) / (4 * math.pi)
        if not mean > 0:
            return False
        stops = math.log2(MIDDLE_GREY / mean) - self.environment.intensity_ev
        self.display.exposure_ev = 0.0
        self.display.expose(round(stops / EXPOSURE_EV_STEP) * EXPOSURE_EV_STEP)
        return True

    def select(self, lobe: int | None) -> None:
        """Select a lobe, or none."""
        self.selection.is_new = lobe is not None and lobe != self.selection.lobe
        self.selection.lobe = lobe

    def _brightest(self) -> int | None:
        """Return the lobe with the most energy in the shown frame, if there are any."""
        return int(energies(self.lobes).argmax()) if self.tracks.lobes.count else None
