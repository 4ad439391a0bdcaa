# SPDX-License-Identifier: Apache-2.0
"""A lamp that leaves its lobe behind goes on in its own track; one that is switched does not."""

from collections.abc import Sequence
from dataclasses import replace

import pytest
import torch
from horizon_lobes import lobes_at

from asglight.lobes import Form, Lobes, asg
from asglight.lobes.data import stack
from asglight.lobes.identity.fragments import fragments_joined

LAMP = 400.0
"""Sharpness: a sigma of 2 degrees."""


def handed_over(
    places: Sequence[float],
    at: int = 2,
    light: tuple[float, float] = (1, 1),
    sharpness: tuple[float, float] = (LAMP, LAMP),
) -> Lobes:
    """A lamp whose light is that of track 0 up to a frame, then that of track 1."""
    return stack(
        [
            lobes_at(
                [place if frame < at else 200, 200 if frame < at else place],
                [light[0] * (frame < at), light[1] * (frame >= at)],
                sharpness,
            )
            for frame, place in enumerate(places)
        ]
    )


def lit(lobes: Lobes) -> list[list[bool]]:
    return (lobes.amplitude > 0).any(-1).tolist()


ONE_TRACK = [[True, False]]


@pytest.mark.parametrize("step", [3, 30, 80])
@pytest.mark.parametrize("form", list(Form))
def test_a_lamp_that_goes_on_is_one_track(step: float, form: Form) -> None:
    given = replace(handed_over([step * frame for frame in range(4)]), form=form)
    found = fragments_joined(given)
    assert lit(found) == ONE_TRACK * 4
    for frame in range(4):
        torch.testing.assert_close(
            asg.evaluate(found[frame], found.axis_z[frame]).amax(0),
            asg.evaluate(given[frame], given.axis_z[frame]).amax(0),
        )


@pytest.mark.parametrize("places", [[0, 20, 55, 105], [0, 40, 70, 85]])
def test_a_lamp_that_passes_nearby_and_turns_faster_or_slower_is_one(places: list[float]) -> None:
    assert lit(fragments_joined(handed_over(places))) == ONE_TRACK * 4


def test_motion_of_one_side_is_enough() -> None:
    begun = fragments_joined(handed_over([0, 30, 60], at=1))  # its first piece is one frame
    ended = fragments_joined(handed_over([0, 30, 60], at=2))
    assert lit(begun) == lit(ended) == ONE_TRACK * 3


def test_of_two_lamps_each_goes_on_in_its_own_track() -> None:
    left, right = (
        [sign * 30 * frame + start for frame in range(4)] for sign, start in ((1, 0), (-1, 120))
    )
    rows = []
    for frame in range(4):
        before = frame < 2
        own = [left[frame], right[frame]]
        rows.append(
            lobes_at(
                [*own, 200, 200] if before else [200, 200, *own[::-1]],
                [1, 1, 0, 0] if before else [0, 0, 1, 1],
                [LAMP] * 4,
            )
        )
    given = stack(rows)
    found = fragments_joined(given)
    assert lit(found) == [[True, True, False, False]] * 4
    for track, places in enumerate((left, right)):
        expected = torch.stack([lobes_at([place], [1], [LAMP]).axis_z[0] for place in places])
        torch.testing.assert_close(found.axis_z[:, track], expected)


@pytest.mark.parametrize(
    "given",
    [
        handed_over([0, 0, 30, 30]),  # one lamp off, the next one on
        handed_over([0, 10, 60, 70]),  # both move, but not from one to the other
        handed_over([0, 30, 0, -30]),  # back
        handed_over([0, 30], at=1),  # nothing moves
        handed_over([0, 30, 60, 90], light=(1, 5)),  # far brighter
        handed_over([0, 30, 60, 90], sharpness=(LAMP, LAMP / 20)),  # over four times as wide
    ],
    ids=["switched", "elsewhere", "back", "two frames", "brighter", "wider"],
)
def test_other_lights_stay_apart(given: Lobes) -> None:
    found = fragments_joined(given)
    assert torch.equal(found.amplitude, given.amplitude)
    assert torch.equal(found.axes, given.axes)


def test_a_track_goes_on_after_it_was_handed_over() -> None:
    """What the other track does later comes along: here it is lit again far away."""
    rows = [
        lobes_at(
            [30 * frame if frame < 2 else 200, 200 if frame < 2 else 30 * frame], light, [LAMP] * 2
        )
        for frame, light in enumerate([[1, 0], [1, 0], [0, 1], [0, 1], [0, 1], [0, 0], [1, 0]])
    ]
    assert lit(fragments_joined(stack(rows))) == [*ONE_TRACK * 5, [False, False], [False, True]]
