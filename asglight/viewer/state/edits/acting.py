# SPDX-License-Identifier: Apache-2.0
"""What is done with lobes that a user points at: which are selected, and what becomes of them."""

from collections.abc import Iterable, Sequence

from asglight.viewer.state import picking
from asglight.viewer.state.edits import editing
from asglight.viewer.state.viewer_state import ViewerState, lobes_max
from asglight.viewer.state.views import Renaming


def together_with(state: ViewerState, lobe: int) -> tuple[int, ...]:
    """Return the lobes that an action on one means: all selected, if it is one of them."""
    selected = state.selected
    others = tuple(other for other in selected if other != lobe)
    return (lobe, *others) if lobe in selected else (lobe,)


def toggle_solo(state: ViewerState, lobes: Iterable[int]) -> None:
    """Let only these and others like them light, or end that."""
    solo, lobes = state.selection.solo, set(lobes)
    if lobes <= solo:
        solo -= lobes
    else:
        solo |= lobes


def delete(state: ViewerState, lobes: tuple[int, ...]) -> None:
    """Delete lobes; none of them is selected or alone any more.

    Of keys it is said what the sum of keys and rest, which was the images, is without them.
    """
    if state.keyed is not None:
        state.message = _without_keys(state, lobes)
    editing.delete(state.history, lobes)
    state.selection.solo -= set(lobes)
    state.select(None)


def _without_keys(state: ViewerState, keys: tuple[int, ...]) -> str:
    energies = picking.energies(state.lobes)
    light = float(energies[list(state.history.present)].sum()) + state.rest_energy
    names = ", ".join(state.lobe_names[key] for key in keys)
    share = 100 * float(energies[list(keys)].sum()) / max(light, 1e-30)  # 1e-30: all is black
    return f"Deleted {names}: {share:.1f} % of this frame's light is gone. The rest stays filled."


def rename(state: ViewerState, lobe: int) -> None:
    """Let a name be typed for a lobe."""
    state.renaming = Renaming(lobe, state.lobe_names[lobe])


def add_lobe(state: ViewerState, direction: Sequence[float]) -> None:
    """Add a lobe and select it, unless there is no room or a fit still brings lobes."""
    if state.is_fitting:
        state.message = "Lobes can be added when the fit has ended."
    elif state.tracks.lobes.count >= lobes_max(state.tracks.lobes.form):
        state.message = f"No room: the viewer holds {state.tracks.lobes.count} lobes."
    else:
        state.select(editing.add(state.history, state.playback.index, direction))


def select_also(state: ViewerState, lobe: int) -> None:
    """Select a lobe beside the others, first of them; or leave it out if it is selected."""
    others = tuple(other for other in state.selected if other != lobe)
    if lobe in state.selected:
        state.selection.lobe = others[0] if others else None
        state.selection.others = others[1:]
    else:
        state.selection.lobe, state.selection.others = lobe, others


def select_to(state: ViewerState, lobe: int, order: Sequence[int]) -> None:
    """Select all lobes of a list from the one selected first to another.

    Args:
        state: The session.
        lobe: The other end.
        order: Indices of the lobes as they are listed.
    """
    selected = state.selected
    start = order.index(selected[0] if selected else lobe)
    end = order.index(lobe)
    between = order[min(start, end) : max(start, end) + 1]
    first = order[start]
    state.selection.lobe = first
    state.selection.others = tuple(other for other in between if other != first)
