# SPDX-License-Identifier: Apache-2.0
"""The list of lobes in the real window: many in view, an edge that is dragged and kept."""

from typing import Any

import pytest
import torch
import windows
from imgui_bundle import ImVec2, imgui
from windows import Driven

from asglight.lobes import Lobes, LobeTracks, frames
from asglight.sphere import latlong
from asglight.viewer.state import settings
from asglight.viewer.state.viewer_state import ViewerState

COUNT = 60


@pytest.fixture
def sixty() -> LobeTracks:
    """Return sixty lobes along the equator, each darker than the one before."""
    u = (torch.arange(COUNT) + 0.5) / COUNT
    axes = frames.axes_around(latlong.direction_from_uv(u, torch.full((COUNT,), 0.5)))
    amplitude = (0.9 ** torch.arange(COUNT))[:, None].expand(COUNT, 3)
    lobes = Lobes(axes[None], torch.full((1, COUNT, 2), 300.0), amplitude[None].clone())
    return LobeTracks((1001,), 24.0, lobes)


def in_view(test: Any) -> int:
    """Count the rows between the first one, which is at the top, and the edge below the list."""
    first, second = (test.item_info(f"Lobes/**/lobe_0{n}").rect_full for n in (0, 1))
    edge = test.item_info("Lobes/##split").rect_full
    return int((edge.min.y - first.min.y) / (second.min.y - first.min.y))


@pytest.mark.parametrize(
    ("size", "least"), [((1600, 1000), 12), ((1024, 640), 9), ((1920, 1080), 12)]
)
def test_a_dozen_of_sixty_lobes_are_in_view_beside_their_controls(
    sixty: LobeTracks, size: tuple[int, int], least: int
) -> None:
    def script(test: Any, driven: Driven) -> None:
        test.window_focus("Lobes")
        driven.state.select(0)
        test.yield_(5)
        assert in_view(test) >= least
        panel = test.window_info("Lobes").window
        for name in ("frames", "azimuth", "height"):
            assert test.item_info(f"Lobes/{name}").rect_full.max.y < panel.pos.y + panel.size.y

    windows.drive(sixty, script, size=size)


def test_the_edge_of_the_list_is_dragged_kept_and_let_go(sixty: LobeTracks) -> None:
    def script(test: Any, driven: Driven) -> None:
        driven.state.select(0)
        test.yield_(5)
        before = in_view(test)
        edge = test.item_info("Lobes/##split").rect_full
        middle = ImVec2((edge.min.x + edge.max.x) / 2, (edge.min.y + edge.max.y) / 2)
        test.mouse_move_to_pos(middle)
        test.mouse_down(0)
        test.mouse_move_to_pos(ImVec2(middle.x, middle.y + 60))
        test.yield_(2)
        test.mouse_up(0)
        test.yield_(2)
        assert test.item_info("Lobes/##split").rect_full.min.y == pytest.approx(
            edge.min.y + 60, abs=6
        )
        assert in_view(test) >= before + 2
        # it is there in the next session
        following = ViewerState(sixty)
        settings.restore(following, settings.as_text(driven.state))
        assert following.list_room.share == driven.state.list_room.share is not None
        # a busy machine may take a second for a picture, and then two clicks are one and one
        io = imgui.get_io()
        io.mouse_single_click_delay, io.mouse_double_click_time = 61.0, 60.0
        test.item_double_click("Lobes/##split")
        test.yield_(3)
        assert driven.state.list_room.share is None
        assert in_view(test) == before

    windows.drive(sixty, script)


def test_controls_that_are_closed_leave_their_room_to_the_list(sixty: LobeTracks) -> None:
    def script(test: Any, driven: Driven) -> None:
        driven.state.select(0)
        test.yield_(5)
        before = in_view(test)
        for section in ("light and colour", "place and size"):
            test.item_click(f"Lobes/{section}")
            test.yield_(3)
        assert in_view(test) > before
        assert not test.item_exists("Lobes/azimuth")
        assert test.item_exists("Lobes/frames")
        test.item_click("Lobes/place and size")
        test.yield_(3)
        assert test.item_exists("Lobes/azimuth")

    windows.drive(sixty, script)
