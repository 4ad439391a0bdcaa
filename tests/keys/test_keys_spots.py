# SPDX-License-Identifier: Apache-2.0
"""Connected spots of a map, across its seam and over its poles."""

import numpy as np

from asglight.keys.spots import Grid, labelled


def test_spots_that_meet_at_the_seam_are_one() -> None:
    marks = np.zeros((16, 32), dtype=bool)
    marks[5, :2] = marks[6, -2:] = True  # they touch by a corner
    marks[10, 15] = True
    labels, count = labelled(marks)
    assert count == 2
    assert labels[5, 0] == labels[6, -1] != labels[10, 15]


def test_spots_that_meet_at_a_pole_are_one_and_both_poles_are_not() -> None:
    marks = np.zeros((16, 32), dtype=bool)
    marks[0, 3] = marks[0, 20] = marks[-1, 3] = True
    labels, count = labelled(marks)
    assert count == 2
    assert labels[0, 3] == labels[0, 20] != labels[-1, 3]


def test_nothing_marked_is_no_spot() -> None:
    labels, count = labelled(np.zeros((8, 16), dtype=bool))
    assert count == 0
    assert not labels.any()


def test_texels_near_a_spot_are_those_that_every_pair_of_angles_says() -> None:
    grid = Grid.of(24, 48)
    for row, column in ((0, 7), (12, 0), (23, 40)):
        mask = np.zeros((24, 48), dtype=bool)
        mask[row, column] = mask[min(row + 1, 23), column - 1] = True
        cosine = grid.directions.reshape(-1, 3) @ grid.directions[mask].T
        angle = np.arccos(np.clip(cosine, -1, 1)).min(1).reshape(24, 48)
        np.testing.assert_array_equal(grid.near(mask, 0.4), angle <= 0.4)
