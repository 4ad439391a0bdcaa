# SPDX-License-Identifier: Apache-2.0
"""What the extension does with objects of Blender, against stand-ins for them."""

from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from blender_stub import Thing, extension

from integrations.blender.plain.tracks import Track, constant


@pytest.fixture(scope="module")
def blender() -> Iterator[SimpleNamespace]:
    with extension("lamps") as modules:
        yield modules


@pytest.fixture
def curves(blender: SimpleNamespace, monkeypatch: pytest.MonkeyPatch) -> dict[str, Track]:
    """Return the curves that properties have."""
    found: dict[str, Track] = {}

    def animate(owner: Thing, path: str, track: Track, *_: Any, held: bool) -> None:
        assert held
        found.pop(path, None)
        setattr(owner, path, bool(track.values[0, 0]))
        if not track.is_constant:
            found[path] = track

    monkeypatch.setattr(blender.lamps, "animate", animate)
    monkeypatch.setattr(blender.lamps, "clear", lambda _, path: found.pop(path, None))
    return found


NEVER, ALWAYS = constant(0.0), constant(1.0)
BLINKS = Track(np.array([1.0, 2.0]), np.array([[0.0], [1.0]]))


@pytest.mark.parametrize("own", [False, True], ids=["shown", "hidden by the user"])
@pytest.mark.parametrize("before", [[NEVER], [BLINKS], [BLINKS, NEVER, BLINKS]])
def test_a_light_is_shown_again_when_its_stage_no_longer_hides_it(
    blender: SimpleNamespace, curves: dict[str, Track], before: list[Track], own: bool
) -> None:
    light = Thing(hide_render=own, hide_viewport=False)
    for visible in (ALWAYS, *before):
        blender.lamps.hide(light, SimpleNamespace(visible=visible), None)
    assert light.hide_render
    assert light.hide_viewport
    assert bool(curves) is (before[-1] is BLINKS)
    blender.lamps.hide(light, SimpleNamespace(visible=ALWAYS), None)
    assert (light.hide_render, light.hide_viewport) == (own, False)
    assert not curves
    light.hide_render = True  # by the user now
    blender.lamps.hide(light, SimpleNamespace(visible=ALWAYS), None)
    assert light.hide_render
