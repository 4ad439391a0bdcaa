# SPDX-License-Identifier: Apache-2.0
"""Histogram and waveform: known pictures, and the panel in the window."""

import math
from typing import Any

import numpy as np
import pytest
from imgui_bundle import imgui
from windows import Drive, Driven

from asglight.lobes import LobeTracks
from asglight.viewer.colour import scopes
from asglight.viewer.state.views import ScopeKind, ScopePlace, ScopeSide


def bin_of(value: float) -> int:
    """Return the bin whose limits hold a radiance, by its definition."""
    step = (scopes.STOPS_HIGH - scopes.STOPS_LOW) / scopes.BINS
    stops = math.log2(value / 0.18)
    found = [n for n in range(scopes.BINS) if abs(scopes.centres()[n] - stops) <= step / 2]
    return found[0]


def test_a_histogram_counts_pixels_by_their_coverage() -> None:
    radiance = np.zeros((4, 8, 3))
    radiance[:, :6] = [0.25, 0.5, 4.0]
    radiance[:, 6:] = 1.3
    weight = np.ones((4, 8))
    weight[:, 0] = 0  # beside the ball
    found = scopes.histogram(radiance, weight)
    np.testing.assert_allclose(found.sum(1), 1)
    for channel, value in enumerate((0.25, 0.5, 4.0)):
        assert found[channel, bin_of(value)] == pytest.approx(5 / 7)
        assert found[channel, bin_of(1.3)] == pytest.approx(2 / 7)


def test_black_and_what_is_beyond_the_range_are_at_its_ends() -> None:
    radiance = np.array([[[0.0, 1e12, 0.2]]])
    found = scopes.histogram(radiance, np.ones((1, 1)))
    assert found[0, 0] == 1
    assert found[1, -1] == 1
    assert not scopes.histogram(radiance, np.zeros((1, 1))).any()


def test_a_waveform_shows_where_a_picture_is_bright() -> None:
    width = 64
    ramp = 0.18 * 2.0 ** np.linspace(-8, 8, width)
    radiance = np.broadcast_to(ramp[None, :, None], (5, width, 3))
    found = scopes.waveform(radiance, np.ones((5, width)))
    assert found.shape == (scopes.BINS, width, 3)
    # each column has one bright bin, higher to the right
    rows = found[..., 1].argmax(0)
    assert (np.diff(rows) < 0).all()
    expected = [scopes.BINS - 1 - bin_of(value) for value in ramp]
    assert np.abs(rows - expected).max() <= 1
    assert ((found > 0).sum(0) == 1).all()
    assert found.max() > 0.99


def test_the_panel_measures_balls_and_map_of_fit_and_reference(
    drive: Drive, two_lamps: LobeTracks
) -> None:
    def script(test: Any, driven: Driven) -> None:
        scope, renderer = driven.state.scope, driven.window.renderer
        imgui.set_window_focus("Scopes")
        test.yield_(4)
        scope.place, scope.side = ScopePlace.MAP, ScopeSide.REFERENCE
        driven.state.map_view.comparison = list(type(driven.state.map_view.comparison))[2]
        test.yield_(4)
        found = renderer.scoped(driven.state)
        assert found is not None
        # the reference is 0.5 everywhere
        np.testing.assert_allclose(found.histogram[:, bin_of(0.5)], 1, rtol=1e-6)
        scope.side, scope.kind = ScopeSide.FIT, ScopeKind.WAVEFORM
        scope.place = ScopePlace.BALLS
        test.yield_(4)
        again = renderer.scoped(driven.state)
        assert again is not None
        assert again.texture > 0
        # nothing is read anew while nothing changes
        assert renderer.scoped(driven.state) is again

    drive(script, with_reference=True)
