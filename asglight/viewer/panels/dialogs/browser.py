# SPDX-License-Identifier: Apache-2.0
"""The file browser inside the window: folders, stages, sequences as one entry, recent files."""

from collections.abc import Callable
from pathlib import Path

from imgui_bundle import ImVec2, imgui

from asglight.viewer.io.browsing import Browser, Entry, Kind
from asglight.viewer.io.documents import Documents
from asglight.viewer.panels import widgets
from asglight.viewer.state.views import Request

_TITLES = {
    Request.OPEN: "Open",
    Request.OPEN_AGAINST: "Open another stage as B",
    Request.SAVE_EDITS: "Save the edits as a layer",
    Request.SAVE_PICTURE: "Save the picture",
    Request.RENDER: "Render the frames: .png, .exr or .mp4",
    Request.RENDER_LABELLED: "Render the frames with labels: .png or .mp4",
    Request.RENDER_TURNTABLE: "Render a turntable: .png, .exr or .mp4",
}

_FRAME = imgui.TableFlags_.row_bg | imgui.TableFlags_.scroll_y | imgui.TableFlags_.borders_outer


def browser(documents: Documents, save: Callable[[Request, Path], None]) -> None:
    """Show the browser while a file is chosen; Escape ends it.

    Args:
        documents: What has it open, and opens what is chosen.
        save: Saves under the name that is chosen.
    """
    shown = documents.browser
    if shown is None:
        return
    if not imgui.is_popup_open("###browser"):
        imgui.open_popup("###browser")
    view = imgui.get_main_viewport()
    size = ImVec2(min(widgets.em(52), 0.9 * view.size.x), min(widgets.em(32), 0.85 * view.size.y))
    imgui.set_next_window_pos(view.get_center(), imgui.Cond_.appearing, ImVec2(0.5, 0.5))
    imgui.set_next_window_size(size, imgui.Cond_.appearing)
    title = f"{_TITLES[shown.request]}###browser"
    if not imgui.begin_popup_modal(title, None, imgui.WindowFlags_.no_docking)[0]:
        return
    chosen = _places(shown)
    chosen = _entries(shown, documents.recent) or chosen
    pressed = _buttons(shown)
    chosen = pressed or chosen
    if chosen or pressed is not None or imgui.is_key_pressed(imgui.Key.escape, False):
        documents.browser = None
        imgui.close_current_popup()
    imgui.end_popup()
    if chosen and shown.is_saving:
        save(shown.request, Path(chosen))
    elif chosen and shown.request is Request.OPEN_AGAINST:
        documents.open_against(chosen)
    elif chosen:
        documents.open(chosen)
    elif documents.browser is None:
        documents.leave_saving()


def _places(shown: Browser) -> str | None:
    """Draw the path, which can be typed: a folder is shown, anything else is opened."""
    if imgui.button("Up"):
        shown.go_to(shown.folder.parent)
    imgui.same_line()
    if imgui.button("Home"):
        shown.go_to(Path.home())
    imgui.same_line()
    imgui.set_next_item_width(-1)
    entered, text = imgui.input_text(
        "##path", str(shown.folder), imgui.InputTextFlags_.enter_returns_true
    )
    widgets.tooltip("Folder, file or pattern such as sky.####.exr. Type it and press Enter")
    if not entered:
        return None
    path = Path(text).expanduser()
    if path.is_dir() or shown.is_saving:
        shown.go_to(path)
        return None
    return str(path)


def _entries(shown: Browser, recent: list[str]) -> str | None:
    """Draw the recent files and the folder; return what was double-clicked."""
    chosen = None
    room = imgui.get_content_region_avail()
    height = room.y - 2.2 * imgui.get_frame_height_with_spacing()
    if recent and not shown.is_saving:
        imgui.begin_child("recent", ImVec2(0.3 * room.x, height))
        imgui.text_disabled("Recent")
        for place, path in enumerate(recent):
            if widgets.line(f"##recent{place}", Path(path).name, False):
                chosen = path
            imgui.set_item_tooltip(path)
        imgui.end_child()
        imgui.same_line()
    if not imgui.begin_table("entries", 2, int(_FRAME), ImVec2(0, height)):
        return chosen
    imgui.table_setup_column("name", imgui.TableColumnFlags_.width_stretch)
    imgui.table_setup_column("kind", imgui.TableColumnFlags_.width_fixed, widgets.em(6))
    for place, entry in enumerate(list(shown.entries)):
        chosen = _entry(shown, entry, place) or chosen
    imgui.end_table()
    return chosen


def _entry(shown: Browser, entry: Entry, place: int) -> str | None:
    imgui.table_next_row()
    imgui.table_next_column()
    name = Path(entry.path).name
    chosen = None
    if widgets.line(f"##entry{place}", entry.title, name == shown.name):
        is_double = imgui.is_mouse_double_clicked(imgui.MouseButton_.left)
        if entry.kind is not Kind.FOLDER or not shown.is_saving:
            shown.name = name
        if is_double and entry.kind is Kind.FOLDER:
            shown.go_to(Path(entry.path))
        elif is_double and not shown.is_saving:
            chosen = entry.path
    imgui.table_next_column()
    imgui.text_disabled(entry.kind)
    return chosen


def _buttons(shown: Browser) -> str | None:
    """Draw the name and the buttons; return what is opened or saved, nothing for Cancel."""
    if shown.finding:
        imgui.text_wrapped(shown.finding)
    imgui.set_next_item_width(-widgets.em(14))
    entered, shown.name = imgui.input_text(
        "##name", shown.name, imgui.InputTextFlags_.enter_returns_true
    )
    widgets.tooltip("Name of the file" if shown.is_saving else "File, folder or pattern to open")
    imgui.same_line()
    label = "Open"
    if shown.is_saving:
        label = "Replace" if shown.target.exists() else "Save"
    has_name = bool(shown.name.strip())
    imgui.begin_disabled(not has_name)
    accepted = imgui.button(f"{label}###accept") or (entered and has_name)
    imgui.end_disabled()
    if shown.is_saving and label == "Replace":
        imgui.set_item_tooltip(f"{shown.target.name} is there already and is replaced")
    imgui.same_line()
    if imgui.button("Cancel"):
        return ""
    if not accepted:
        return None
    return str(shown.target)
