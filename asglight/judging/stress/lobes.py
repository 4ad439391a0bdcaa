# SPDX-License-Identifier: Apache-2.0
"""Stress cases made of known lobes: stiff ones, and ones that a fit has to find again."""

import functools
from collections.abc import Callable

from asglight.judging.stress.case import (
    FOUND,
    GRADIENT,
    IRRADIANCE,
    Bound,
    Case,
    Group,
    of_lobes,
)
from asglight.judging.stress.maps import SUN, lamps, lobe, together, toward
from asglight.lobes import Form, Lobes
from asglight.sphere.quadrature import fibonacci_directions

ROWS = 128
"""Of their maps: a texel of 1.4 degrees."""

FINE_ROWS = 256
"""Of those whose shape has to be seen: what a fit works on at most."""

POLE = (0.0, 1.0, 0.0)
SEAM = toward(180.0, 0.0)
TEXEL_CORNER = toward(45.0, 45.0)
"""Where four texels of any of these maps meet."""


Sharpness = float | tuple[float, float]


def _one(sharpness: Sharpness, form: Form = Form.ASG) -> Callable[[], list[Lobes]]:
    """Return a lobe whose flux is about the same for any sharpness."""
    brightness = max(1.0, max(sharpness) if isinstance(sharpness, tuple) else sharpness)
    return lambda: [lobe(SUN, sharpness, brightness, form=form, turn_deg=30.0)]


HELD = Bound(
    0.1,
    "The gradient takes a texel's shape as that at the lobe's centre; along this lobe it changes.",
)


LONG = Bound(
    0.02, "One lobe for a band half around the sphere, thinner than the texels that it is seen by."
)


_stiff = functools.partial(of_lobes, Group.STIFF, rows=ROWS)


def _ratio(x: float, y: float, irradiance: Bound = IRRADIANCE, gradient: Bound = GRADIENT) -> Case:
    name, holds = f"ratio-{x:g}-{y:g}", f"sharpness {x:g} by {y:g}"
    return _stiff(name, holds, _one((x, y)), irradiance=irradiance, gradient=gradient)


SHARPNESS = (1e-3, 1e-1, 1.0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7)

STIFF = (
    *(_stiff(f"sharpness-{s:g}", f"one lobe of sharpness {s:g}", _one(s)) for s in SHARPNESS),
    _ratio(1e3, 1e2),
    _ratio(1e4, 1e2),
    _ratio(1e4, 1e1),
    _ratio(1e4, 1.0, LONG),
    _ratio(1e7, 1e3),
    _ratio(1e7, 1e-3, LONG, HELD),
    *(
        _stiff(f"{form}-{s:g}", f"form {form}, sharpness {s:g}", _one(s, form), form=form)
        for form in (Form.SG, Form.BINGHAM, Form.FLAT)
        for s in (1e-3, 1e2, 1e7)
    ),
    _stiff(
        "on-top",
        "two lobes a twentieth of their width apart",
        lambda: [together(lobe(SUN, 100.0), lobe(toward(40.2, 30.1), 100.0))],
        lobes=2,
    ),
    _stiff(
        "identical", "the same lobe twice", lambda: [together(*(lobe(SUN, 100.0),) * 2)], lobes=2
    ),
    _stiff(
        "one-in-another",
        "sharpness 1e4 in the middle of 10",
        lambda: [together(lobe(SUN, 1e4, 100.0), lobe(SUN, 10.0))],
        lobes=2,
    ),
    _stiff("pole", "a long lobe on the pole", lambda: [lobe(POLE, (100.0, 20.0))], gradient=HELD),
    _stiff("pole-thin", "thinner than a texel, on the pole", lambda: [lobe(POLE, 1e6, 1e6)]),
    _stiff("seam", "a long lobe on the seam", lambda: [lobe(toward(180, 10), (100.0, 20.0))]),
    _stiff("seam-thin", "thinner than a texel, on the seam", lambda: [lobe(SEAM, 1e6, 1e6)]),
    _stiff(
        "corner-thin",
        "thinner than a texel, where four meet",
        lambda: [lobe(TEXEL_CORNER, 1e6, 1e6)],
    ),
    _stiff(
        "lamps-200",
        "200 equal lamps, 15 lobes",
        lambda: [lamps(fibonacci_directions(200).tolist(), 2e3)],
        lobes=15,
    ),
    _stiff(
        "lamps-6",
        "six equal lamps on the axes, 6 lobes",
        lambda: [lamps([(1, 0, 0), (-1, 0, 0), POLE, (0, -1, 0), (0, 0, 1), (0, 0, -1)], 2e3)],
        lobes=6,
    ),
)


def _found(
    name: str,
    holds: str,
    known: Callable[[], list[Lobes]],
    count: int,
    form: Form = Form.ASG,
    gradient: Bound = GRADIENT,
) -> Case:
    """Return a case whose lobes, `count` of them a frame, are to be found again as `FOUND` asks."""
    return of_lobes(
        Group.RECOVERY,
        name,
        holds,
        known,
        rows=FINE_ROWS if count == 1 else ROWS,
        lobes=count,
        form=form,
        recovery=FOUND,
        gradient=gradient,
    )


def _studio() -> Lobes:
    """Return five lamps of different widths, colours and shapes, none within another."""
    return together(
        lobe(toward(0, 30), (60.0, 20.0), (2.0, 1.5, 1.0), turn_deg=20.0),
        lobe(toward(80, -10), 200.0, (1.0, 2.0, 5.0)),
        lobe(toward(-70, 50), (400.0, 100.0), (8.0, 8.0, 8.0), turn_deg=70.0),
        lobe(toward(170, 20), 40.0, (3.0, 0.5, 0.5)),
        lobe(toward(-130, -50), (25.0, 10.0), (0.5, 1.5, 0.8)),
    )


def _overlapping() -> Lobes:
    """Return three lobes that reach into each other."""
    return together(
        lobe(toward(0, 30), 30.0, (1.0, 0.2, 0.2)),
        lobe(toward(14, 30), 30.0, (0.2, 1.0, 0.2)),
        lobe(toward(7, 42), 30.0, (0.2, 0.2, 1.0)),
    )


def _day() -> Lobes:
    """Return a sky, its horizon and a sun."""
    return together(
        lobe((0.0, 1.0, 0.1), 1.0, (0.3, 0.5, 1.0)),
        lobe(toward(40, 2), (40.0, 2.0), (0.8, 0.7, 0.6)),
        lobe(SUN, 1500.0, (900.0, 800.0, 600.0)),
    )


def _moving() -> list[Lobes]:
    """Return a lamp that moves four degrees a frame, and one that stands."""
    still = lobe(toward(-100, -20), 30.0, (0.5, 0.6, 1.0))
    return [together(lobe(toward(4.0 * k, 30), 80.0, (2.0, 1.5, 1.0)), still) for k in range(5)]


RECOVERY = (
    _found("one-broad", "sharpness 2", _one(2.0), 1),
    _found("one-round", "sharpness 50", _one(50.0), 1),
    _found("one-narrow", "sharpness 1e3, as wide as two texels", _one(1e3), 1),
    _found("one-long", "sharpness 400 by 4", _one((400.0, 4.0)), 1),
    _found(
        "one-pole",
        "on the pole",
        lambda: [lobe(POLE, (80.0, 20.0), 3.0)],
        1,
        gradient=HELD,
    ),
    _found("one-seam", "on the seam", lambda: [lobe(toward(180, -20), 80.0, 3.0)], 1),
    _found("one-sg", "form sg, sharpness 50", _one(50.0, Form.SG), 1, Form.SG),
    _found("one-flat", "form flat, 50 by 10", _one((50.0, 10.0), Form.FLAT), 1, Form.FLAT),
    _found(
        "one-bingham",
        "form bingham, 50 by 10",
        _one((50.0, 10.0), Form.BINGHAM),
        1,
        Form.BINGHAM,
    ),
    _found("dim", "sharpness 50, amplitude 1e-9", lambda: [lobe(SUN, 50.0, 1e-9)], 1),
    _found("bright", "sharpness 50, amplitude 1e9", lambda: [lobe(SUN, 50.0, 1e9)], 1),
    _found("studio", "five lamps apart from each other", lambda: [_studio()], 5),
    _found("overlapping", "three lobes that reach into each other", lambda: [_overlapping()], 3),
    _found("day", "a sky, a bright horizon and a sun", lambda: [_day()], 3),
    _found("moving", "one of two lamps moves, 5 frames", _moving, 2),
)
