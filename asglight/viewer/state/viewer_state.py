# SPDX-License-Identifier: Apache-2.0
"""What the viewer shows: plain data, the single truth of a session. No OpenGL, no window."""

import math
import time
from collections.abc import Callable, Iterable

import numpy as np
import torch

from asglight.errors import InputError
from asglight.lobes import Form, Lobes, LobeTracks, asg, flat
from asglight.luminance import luminance
from asglight.viewer.reference.images import Reference
from asglight.viewer.reference.rest import Keyed, energy_of, flux_of
from asglight.viewer.state.balls import WHITE, Ball, Material, Rgb, ball_row
from asglight.viewer.state.camera import Camera
from asglight.viewer.state.compared.against import Against
from asglight.viewer.state.display import (
    EXPOSURE_EV_STEP,
    MIDDLE_GREY,
    Comparison,
    Display,
    Subject,
)
from asglight.viewer.state.edits import carrying, editing
from asglight.viewer.state.edits.editing import Editing, Moment
from asglight.viewer.state.edits.history import EditHistory
from asglight.viewer.state.held import Held
from asglight.viewer.state.map_frame import MapFrame
from asglight.viewer.state.picking import energies
from asglight.viewer.state.shown import dissolved, shown_lobes
from asglight.viewer.state.time.playback import Playback
from asglight.viewer.state.time.time_span import TimeSpan
from asglight.viewer.state.views import (
    GROUND_BALL,
    Compared,
    Environment,
    Inspected,
    ListRoom,
    Outlines,
    Probe,
    Renaming,
    Request,
    Scene,
    Scope,
    Selection,
    Theme,
)

MAX_LOBES = 128
"""Lobes in a frame: 8 KiB of the 16 KiB that every OpenGL has for a uniform block."""

SHEETS_MAX = 2 * MAX_LOBES
"""Of all lobes together (shading/sheets.py): two of each of the bingham form, three of the flat."""

INTENSITY_EV_MAX = 10.0
"""Stops by which the environment can be made brighter or darker."""


def lobes_max(form: Form) -> int:
    """Return how many lobes of a form the viewer holds."""
    return SHEETS_MAX // len(flat.TERMS) if form is Form.FLAT else MAX_LOBES


def check_count(tracks: LobeTracks) -> None:
    """Refuse more lobes than there is room for.

    Raises:
        InputError: There are more lobes than `lobes_max`.
    """
    most = lobes_max(tracks.lobes.form)
    if tracks.lobes.count > most:
        raise InputError(
            f"tracks: {tracks.lobes.count} lobes; expected at most {most}, which is "
            "what the viewer holds. Fit fewer with --lobes."
        )


class ViewerState:
    """A session of the viewer.

    Attributes:
        history: The tracks with their edits.
        playback: The playhead.
        span: The part of the shot that the timeline shows.
        keyed: What a stage shows beside its keys, which its tracks are then; None of other stages.
        references: Images of the same frames to compare with, or None.
        against: Another fit to compare with, or None.
        display: How radiance is shown.
        camera: Where the balls are seen from.
        environment: What is around them.
        compared: What the balls show of fit and reference.
        map_view: What the map shows of them.
        selection: Which lobes are looked at and which light.
        scene: What the lights shine on.
        ground_ball: Index in the row of the ball that stands on the ground.
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
        is_pinned: Whether it stays there.
        map_frame: Which part of the map is shown.
        scope: What histogram and waveform are of.
        fitted: Frames whose lobes are known; None for all.
        is_fitting: Whether more lobes will come.
        editing: Where edits hold, and what the hand holds.
        list_room: How high the list of lobes is.
        renaming: The name of a lobe that is being typed, or None.
        moves_wipe: Whether the drag that goes on began on the wipe line.
        requests: What the window is to do.
    """

    def __init__(
        self,
        tracks: LobeTracks,
        references: Reference | None = None,
        clock: Callable[[], float] = time.monotonic,
        muted: Iterable[int] = (),
        keyed: Keyed | None = None,
    ) -> None:
        """Show tracks from their first frame on.

        Args:
            tracks: At least one frame; lobes that are muted as they would light.
            references: Images to compare with.
            clock: Seconds on a steady clock, for playing.
            muted: Indices of the lobes that are muted.
            keyed: What the stage shows beside its keys, which the tracks are then.

        Raises:
            InputError: There are more lobes than `lobes_max`.
        """
        self.clock = clock
        self.display = Display()
        self.camera = Camera()
        self.environment = Environment()
        self.compared = Compared()
        self.map_view = Compared()
        self.scene = Scene.BALLS
        self.ground_ball = GROUND_BALL
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
        self.list_room = ListRoom()
        self.renaming: Renaming | None = None
        self.inspected: Inspected | None = None
        self.probe: Probe | None = None
        self.is_pinned = False
        self.map_frame = MapFrame()
        self.scope = Scope()
        self.fitted: frozenset[int] | None = None
        self.is_fitting = False
        self.requests: list[Request] = []
        self.keyed = keyed
        self.references: Reference | None = None
        self.against: Against | None = None
        check_count(tracks)
        self.history = EditHistory(tracks, muted, are_keys=keyed is not None)
        self.playback = Playback(tracks.frames, tracks.fps)
        self.span = TimeSpan(tracks.frames[0], tracks.frames[-1] + 1)
        self.selection = Selection(self.brightest())
        self.compare_with(references)

    def compare_with(self, references: Reference | None) -> None:
        """Compare with the images of another sequence, or with none."""
        if self.references is not None:
            self.references.close()
        self.references = references
        self.compared.comparison = Comparison.ROWS if self.subjects else Comparison.FIT
        self.map_view.comparison = self._map_at_first()

    def compare_against(self, against: Against | None) -> None:
        """Hold another fit against this one, or none any more.

        Raises:
            InputError: It has more lobes than `lobes_max`.
        """
        if against is not None:
            check_count(against.tracks)
            self.compared.subject = Subject.AGAINST
        self.against = against
        has_two = bool(self.subjects)
        self.compared.comparison = Comparison.ROWS if has_two else Comparison.FIT
        self.map_view.comparison = Comparison.WIPE if against is not None else self._map_at_first()

    def _map_at_first(self) -> Comparison:
        return Comparison.REFERENCE if self.references else Comparison.FIT

    def replace_tracks(self, tracks: LobeTracks) -> None:
        """Take over newer lobes, with the edits that were made to the older ones."""
        had_lobes = self.tracks.lobes.count > 0
        places, edits = carrying.places_in(tracks, self.history.original), self.history.edits
        self.history = self.history.over(tracks, places)
        places.select(self.selection)
        self.renaming = places.renaming(self.renaming)
        lost = len(edits) - len(self.history.edits)
        if lost:
            self.message = carrying.gone(lost)
        if not had_lobes:
            self.select(self.brightest())
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
        """What the lobes are called."""
        return self.history.names

    @property
    def lobes(self) -> Lobes:
        """All lobes of the shown time.  [N, .]."""
        return shown_lobes(Held(self.tracks), self.playback.index, self.playback.part)

    def fitted_lobe(self, lobe: int) -> Lobes:
        """Return a lobe in the shown frame as it was before any edit.  [.]."""
        return self.history.first_track(lobe)[self.playback.index]

    @property
    def moment(self) -> Moment:
        """The playhead and its marks."""
        return Moment(self.playback.index, self.playback.first, self.playback.last)

    @property
    def selected(self) -> tuple[int, ...]:
        """Indices of the selected lobes that are there; the first has the controls."""
        every = (self.selection.lobe, *self.selection.others)
        present = self.history.present
        return tuple(lobe for lobe in every if lobe in present)

    @property
    def is_fitted(self) -> bool:
        """Whether the shown time has its lobes: its frame, or both that it lies between."""
        has_light = self.tracks.lobes.count > 0 or self.keyed is not None
        frames = {self.playback.frame, *((self.playback.next_frame,) * self.playback.is_between)}
        return has_light and (self.fitted is None or self.fitted >= frames)

    @property
    def lit(self) -> tuple[int, ...]:
        """Indices of the lobes that light: neither muted nor outside a solo of lobes there are."""
        muted, present = self.history.muted, self.history.present
        solo = self.selection.solo.intersection(present)
        return tuple(n for n in present if n not in muted and (not solo or n in solo))

    def toggle_mute(self, *lobes: int) -> None:
        """Mute lobes, or let them light again: an edit as any other."""
        editing.toggle_mute(self.history, lobes)

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
    def subject(self) -> Subject:
        """What counts as fit and as reference: of what there is to compare."""
        wanted = self.compared.subject
        return wanted if wanted in self.subjects else next(iter(self.subjects), Subject.TOTAL)

    @property
    def subjects(self) -> tuple[Subject, ...]:
        """What can be compared."""
        of_images = (Subject.TOTAL, Subject.FIT, Subject.SHADING) if self.references else ()
        return (*of_images, Subject.AGAINST) if self.against else of_images

    @property
    def parts(self) -> int:
        """How many rows of balls there are where all are shown one above the other."""
        if self.scene is Scene.GROUND:
            return 1
        if self.subject is Subject.AGAINST:
            return 3 if self.references else 2
        return 2 if self.references else 1

    @property
    def shown(self) -> Comparison:
        """What the balls show: without a reference the fit, without any lobe the reference.

        On the ground it is the fit: a map's shadows have no closed form.
        """
        return Comparison.FIT if self.scene is Scene.GROUND else self._shown(self.compared)

    @property
    def shown_map(self) -> Comparison:
        """What the map shows of them."""
        return self._shown(self.map_view)

    def _shown(self, compared: Compared) -> Comparison:
        if not self.subjects:
            return Comparison.FIT
        has_light = self.tracks.lobes.count or self.keyed is not None
        return compared.shown if self.against or has_light else Comparison.REFERENCE

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

    @property
    def rest_energy(self) -> float:
        """The energy of the rest, as `picking.energies` counts that of keys."""
        image = self.rest_image
        return 0.0 if image is None else energy_of(Held(image))

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
        mean = float(luminance(flux)) / (4 * math.pi)
        if not mean > 0:
            return False
        stops = math.log2(MIDDLE_GREY / mean) - self.environment.intensity_ev
        self.display.exposure_ev = 0.0
        self.display.expose(round(stops / EXPOSURE_EV_STEP) * EXPOSURE_EV_STEP)
        return True

    def select(self, lobe: int | None) -> None:
        """Select a lobe alone, or none."""
        self.selection.is_new = lobe is not None and lobe != self.selection.lobe
        self.selection.lobe, self.selection.others = lobe, ()

    def brightest(self) -> int | None:
        """Return the lobe with the most energy in the shown frame, if there are any."""
        return int(energies(self.lobes).argmax()) if self.tracks.lobes.count else None
