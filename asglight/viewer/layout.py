# SPDX-License-Identifier: Apache-2.0
"""Where the panels are docked at first: balls over map and curves, controls right, time below."""

from imgui_bundle import hello_imgui, imgui

FONT_POINTS = 15.0
"""Height of the font of hello_imgui on a screen of usual density."""

_TIMELINE_EM = 7.0
"""Height of the timeline: its tab, its buttons, its bar."""

_RIGHT_EM = 20.0
"""Width of the controls at least: a slider and its name."""

_LOBES_SHARE = 0.66
"""Of the height on the right that lobes have: a list of many rows, and numbers."""

_STACKED_EM = 50.0
"""Height from which lobes stand below the look; in less room both are tabs of one place."""

_INSPECTOR_EM = 10.8
"""Height of the inspector: its tab, its buttons and five lines."""


def splits(size: tuple[int, int], em: float) -> list[hello_imgui.DockingSplit]:
    """Return how the window is divided.

    Args:
        size: Its columns and rows.
        em: Height of the font, in the same unit.
    """
    down, right = imgui.Dir.down, imgui.Dir.right
    columns, rows = size
    of_right = min(max(0.24, _RIGHT_EM * em / columns), 0.45)
    is_stacked = rows >= _STACKED_EM * em
    inspector = min(_INSPECTOR_EM * em / rows, 0.3)
    found = [hello_imgui.DockingSplit("MainDockSpace", "RightSpace", right, of_right)]
    found.append(hello_imgui.DockingSplit("RightSpace", "InspectorSpace", down, inspector))
    if is_stacked:
        found.append(hello_imgui.DockingSplit("RightSpace", "LobesSpace", down, _LOBES_SHARE))
    timeline = min(_TIMELINE_EM * em / rows, 0.3)
    return [
        *found,
        hello_imgui.DockingSplit("MainDockSpace", "TimelineSpace", down, timeline),
        hello_imgui.DockingSplit("MainDockSpace", "LowerSpace", down, 0.42),
        hello_imgui.DockingSplit("LowerSpace", "CurvesSpace", right, 0.5),
    ]


def has_room(size: tuple[int, int], em: float) -> bool:
    """Tell whether lobes and look stand one below the other."""
    return size[1] >= _STACKED_EM * em
