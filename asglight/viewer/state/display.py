# SPDX-License-Identifier: Apache-2.0
"""How radiance is shown: exposure, view transform, channel, zebra. Nothing here shades anew."""

from dataclasses import dataclass, field
from enum import StrEnum

EXPOSURE_EV_MAX = 20.0
"""Stops up and down: 2^-20 brings a sun of a million into range."""

EXPOSURE_EV_STEP = 0.5
"""Stops for one press of a key."""

MIDDLE_GREY = 0.18
"""Radiance of 0 EV in false colour: the diffuse grey that a light meter aims at."""

FALSE_COLOUR_EV = 8.0
"""Stops from the middle of the false-colour scale to its ends."""

RATIO_EV = 3.0
"""Stops from the middle of the scale of ratios to its ends."""


class ViewTransform(StrEnum):
    """How exposed radiance becomes a colour of the screen."""

    SRGB = "sRGB"
    """Clipped at 1: below it, the picture is plain sRGB."""
    FILMIC = "filmic"
    """The curve that Narkowicz 2015 fitted to the ACES reference rendering transform."""
    FALSE_COLOUR = "false colour"
    """Luminance in stops from middle grey."""
    OPENCOLORIO = "OpenColorIO"
    """A view of an OpenColorIO config, such as those of ACES."""


class Comparison(StrEnum):
    """Which of two pictures is shown, or what of both."""

    ROWS = "one above the other"
    FIT = "fit"
    REFERENCE = "reference"
    WIPE = "wipe"
    """The fit on the left of a line that can be dragged, the reference on its right."""
    DIFFERENCE = "difference"
    """Fit minus reference, exposed, in false colour."""
    RATIO = "ratio"
    """Fit over reference, in stops, in false colour."""


class Subject(StrEnum):
    """What is compared with what, so that an error has one cause."""

    TOTAL = "overall"
    """The lobes' closed form against the map's integral: what a user of the lights sees."""
    FIT = "fit only"
    """The lobes' integral against the map's: what the lobes lack."""
    SHADING = "shading only"
    """The lobes' closed form against their integral: what the formulas lack."""
    AGAINST = "A and B"
    """The closed form of one fit against that of another; both against the map's integral."""


class Channel(StrEnum):
    """What of the radiance is shown."""

    RGB = "RGB"
    RED = "R"
    GREEN = "G"
    BLUE = "B"
    LUMINANCE = "Y"
    """Rec. 709 luminance."""


@dataclass(frozen=True)
class ColourView:
    """A view of an OpenColorIO config (colour/opencolorio.py has the configs).

    Attributes:
        config: Name of the config.
        display: What the screen is, as the config calls it.
        view: How it is shown there.
    """

    config: str = "ACES 2.0"
    display: str = "sRGB - Display"
    view: str = "ACES 2.0 - SDR 100 nits (Rec.709)"

    def __str__(self) -> str:
        """Return it in one line: the view, which says its config, and the screen."""
        return f"{self.view}, {self.display.removesuffix(' - Display')}"


@dataclass
class Display:
    """How radiance is shown.

    Attributes:
        exposure_ev: Stops; radiance is multiplied by 2^exposure_ev.
        transform: How it becomes a colour.
        channel: What of it is shown.
        zebra: Whether stripes mark what the screen clips.
        colour_view: What the OpenColorIO view is.
    """

    exposure_ev: float = 0.0
    transform: ViewTransform = ViewTransform.SRGB
    channel: Channel = Channel.RGB
    zebra: bool = False
    colour_view: ColourView = field(default_factory=ColourView)

    @property
    def name(self) -> str:
        """What the view is called."""
        is_ocio = self.transform is ViewTransform.OPENCOLORIO
        return str(self.colour_view) if is_ocio else str(self.transform)

    def expose(self, stops: float) -> None:
        """Change the exposure, within +-EXPOSURE_EV_MAX."""
        wanted = self.exposure_ev + stops
        self.exposure_ev = max(-EXPOSURE_EV_MAX, min(EXPOSURE_EV_MAX, wanted))
