# SPDX-License-Identifier: Apache-2.0
"""What the extension does with objects of Blender, against stand-ins for them."""

import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import written_stages
from blender_stub import Thing, extension
from usd_tracks import of_every_kind

from integrations.blender.plain.command import Run
from integrations.blender.plain.tracks import Track, constant


@pytest.fixture(scope="module")
def blender() -> Iterator[SimpleNamespace]:
    with extension("building", "fitting", "lamps", "panel", "saving") as modules:
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


def saved(blender: SimpleNamespace, stage: Path, kind: str, strength: float = 1.0) -> Any:
    """Look at a rig of one light."""
    written_stages.put(of_every_kind((1001,)), stage, dome_height=8)
    path = "/AsgRig/Lobes/lobe_02"
    light = Thing(
        {"asglight_prim": path}, type="LIGHT", name="my lamp", data=SimpleNamespace(type=kind)
    )
    properties = {"asglight_stage": str(stage), "asglight_prim": "/AsgRig"}
    properties |= {"asglight_strength": strength, "asglight_representation": "cards"}
    rig = Thing(properties, children_recursive=[light])
    return blender.saving.seen_of(SimpleNamespace(scene=None), rig)


@pytest.mark.parametrize("kind", ["POINT", "SPOT", "SUN"])
def test_a_light_of_a_type_that_the_stage_cannot_hold_is_refused_in_a_line(
    blender: SimpleNamespace, tmp_path: Path, kind: str
) -> None:
    said = (
        f"^cannot hold my lamp, a {kind.title()} light now; expected Area. Change its type back, "
        "or delete it$"
    )
    with pytest.raises(ValueError, match=said):
        saved(blender, tmp_path / "shot.usda", kind)


def test_a_rig_without_strength_is_refused_in_a_line(
    blender: SimpleNamespace, tmp_path: Path
) -> None:
    with pytest.raises(ValueError, match=r"^was imported with strength 0, which leaves no"):
        saved(blender, tmp_path / "shot.usda", "AREA", strength=0.0)


class Layout:
    """A part of a panel; keeps the buttons that are drawn.

    Attributes:
        buttons: By operator, what is handed to it.
    """

    def __init__(self) -> None:
        self.buttons: dict[str, SimpleNamespace] = {}

    def box(self, **_: Any) -> "Layout":
        return self

    row = column = box

    def label(self, **_: Any) -> None:
        pass

    def prop(self, *_: Any, **__: Any) -> None:
        pass

    def operator(self, name: str, **_: Any) -> SimpleNamespace:
        return self.buttons.setdefault(name, SimpleNamespace())


def handed_over(blender: SimpleNamespace, rig: Thing) -> dict[str, Any]:
    layout = Layout()
    panel = blender.panel.ASGLIGHT_PT_rigs()
    panel.layout = layout
    panel._rig(rig)
    return vars(layout.buttons["import_scene.asglight"])


@pytest.mark.parametrize("chosen", [True, False])
def test_read_again_hands_over_all_that_the_rig_was_imported_with(
    blender: SimpleNamespace, chosen: bool
) -> None:
    wished = {"distance": 20.0, "offset": 100, "strength": 2.0}
    wished |= {"use_world": chosen, "set_time": not chosen, "seen": chosen}
    wishes = blender.building.Wishes(stage="/a/shot.usda", scale=1.0, shown_as="cards", **wished)
    rig = Thing(name="shot", children_recursive=[])
    of_stage = SimpleNamespace(path="/AsgRig", representation="cards")
    blender.building.remember(rig, of_stage, wishes)
    asked = {"filepath": "/a/shot.usda", "rig": "shot", "representation": "cards"}
    assert handed_over(blender, rig) == asked | wished
    for name in ("use_world", "set_time", "seen"):  # a rig of a file from before they were noted
        del rig[f"asglight_{name}"]
    usual = {"use_world": True, "set_time": True, "seen": False}
    assert handed_over(blender, rig) == asked | wished | usual


@pytest.mark.parametrize("workspace", [None, SimpleNamespace(status_text_set=lambda _: None)])
def test_a_fit_ends_with_blender_or_the_file_it_was_started_in(
    blender: SimpleNamespace, workspace: SimpleNamespace | None
) -> None:
    timers = ["mine"]
    manager = SimpleNamespace(event_timer_remove=timers.remove, progress_end=lambda: None)
    context = SimpleNamespace(window_manager=manager, workspace=workspace)
    fit = blender.fitting.ASGLIGHT_OT_fit_world()
    fit.cancel(context)  # no file was chosen, so there is no command yet
    assert timers == ["mine"]
    fit._run = Run([sys.executable, "-c", "import time; time.sleep(60)"])
    fit._timer = "mine"
    assert fit._run.poll() is None
    fit.cancel(context)
    assert fit._run.poll() not in (None, 0)
    assert timers == []
