# SPDX-License-Identifier: Apache-2.0
"""The panel that docs/contributing/panel.md adds, in a window."""

import re
from pathlib import Path
from typing import Any

import pytest
from imgui_bundle import imgui
from windows import Drive, Driven

from asglight.lobes import asg
from asglight.viewer import window

PAGE = Path(__file__).resolve().parents[3] / "docs" / "contributing" / "panel.md"


def test_the_panel_of_the_page_draws_and_changes_the_state(
    drive: Drive, monkeypatch: pytest.MonkeyPatch
) -> None:
    names: dict = {}
    exec(re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)[0], names)
    drawn: list[str] = []
    text = imgui.text

    def inspector(state: Any, *_: Any) -> None:
        monkeypatch.setattr(imgui, "text", lambda words: (drawn.append(words), text(words)))
        names["totals"](state)
        monkeypatch.setattr(imgui, "text", text)

    monkeypatch.setattr(window, "inspector", inspector)

    def script(test: Any, driven: Driven) -> None:
        driven.state.display.exposure_ev = 3.0
        test.item_click("//Inspector/reset exposure")
        test.yield_(2)
        assert driven.state.display.exposure_ev == 0.0
        flux = asg.flux(driven.state.tracks.lobes[0]).sum(0).tolist()
        assert drawn[-1].split()[1:] == [f"{channel:.4g}" for channel in flux]

    drive(script)
