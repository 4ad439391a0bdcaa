# SPDX-License-Identifier: Apache-2.0
"""Lights that were edited in another program, turned back into lobes.

A stage says the same thing twice: what a lobe is, and the lights derived from it. Other programs
know lights only. So the lights of the selected variant are compared with those that `write_usd`
would author, and where they differ the lobe is changed to one whose lights they are:

- direction and turn: by the rotation from the authored light's frame to the edited one's; a card
  stands where its centre is seen from the rig's origin;
- sharpness: so that the derived sizes are the edited ones; a card's size scales with its distance;
- amplitude: so that the derived light is the edited one, in each channel;
- a lobe that is invisible is black; a rig or a dome that was turned turns all lobes.

A lobe whose own attributes were overridden is what they say, whatever its lights are: its digest
(asglight.usd.digest) is no longer that of what was written.

Dimension letters: F frames, N lobes.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray
from pxr import Gf, Usd, UsdGeom
from torch import Tensor

from asglight.lobes import Form, Lobes, frames
from asglight.usd import schema
from asglight.usd.digest import has_own_edits
from asglight.usd.lights.cards import Kind
from asglight.usd.read.held_lights import EDITED, Array, LobeLights, View, Written, held_lights
from asglight.usd.read.read_options import card_kinds, threefold_lobes
from asglight.usd.schema import Representation
from asglight.usd.write.checks import SHARPNESS_RANGE

TURNED_DEG = 0.01
"""Of a light whose transform is not the authored one: float32 matrices keep a hundredth of that."""

STEPS = 40
"""Of the fixed point from sizes to sharpness: narrow lobes, whose squared sines are in inverse
proportion to it, need one; broad ones, whose sines change less, the more."""

Derived = Callable[[Lobes], LobeLights]
"""From a lobe to its lights, taken together as those that were written."""


def with_light_edits(
    rig: Usd.Prim,
    prims: Sequence[Usd.Prim],
    lobes: Lobes,
    times: tuple[int, ...],
    distance: float,
) -> tuple[Lobes, list[str]]:
    """Return the lobes that the lights of the selected variant show.

    Args:
        rig: The prim that holds the lobes.
        prims: Those of the lobes.
        lobes: As their own attributes say, in the stage's space.  [F, N, .]
        times: Frame numbers.
        distance: Of the cards as written.

    Returns:
        The lobes, and what was changed, one line each: `<prim>: <what>`.
    """
    selected = rig.GetVariantSet(schema.VARIANT_SET).GetVariantSelection()
    changes = [
        f"{prim.GetPath()}: switched off"
        for prim in rig.GetChild(schema.LOBES).GetAllChildren()
        if not prim.IsActive()
    ]
    lobes = lobes.to(torch.float64)
    if selected in set(Representation):
        kinds, threefold = card_kinds(rig), threefold_lobes(rig)
        view = View(rig, times, Representation(selected), distance, kinds, threefold)
        if view.representation is Representation.DOME:
            lobes, found = _with_dome(view, lobes, schema.DOME, [True] * len(prims))
        else:
            lobes, found = _with_lights(view, prims, lobes)
        changes += found
        if view.is_cards and Kind.FILL in kinds:
            lobes, found = _with_dome(
                view, lobes, schema.FILL, [kind is Kind.FILL for kind in kinds]
            )
            changes += found
    lobes, found = _with_visibility(prims, lobes, times)
    changes += found
    lobes, found = _turned_rig(rig, lobes, times)
    return lobes.to(torch.float32), changes + found


def _with_lights(view: View, prims: Sequence[Usd.Prim], lobes: Lobes) -> tuple[Lobes, list[str]]:
    changes: list[str] = []
    authored = view.lights(lobes, range(len(prims)))
    lobes = lobes.clone()
    for index, prim in enumerate(prims):
        if not authored[index] or has_own_edits(prim):
            continue
        own = lobes.select(torch.tensor([index]))
        written = Written.of(view, authored[index])
        held = held_lights(prim, own, written)
        if held is None:
            kind = schema.LIGHT_TYPES[view.representation]
            changes.append(f"{prim.GetPath()}: has no {kind}; its lobe is as it was")
            continue
        was = written.together(written.lights)
        words = _words(view, was, held)
        if words:
            changes.append(f"{prim.GetPath()}: {', '.join(words)}")

            def derived(lobe: Lobes, index: int = index, written: Written = written) -> LobeLights:
                return written.together(view.lights(lobe, [index])[0])

            changed = _changed(view, own, was, held, derived)
            lobes.axes[:, index] = changed.axes[:, 0]
            lobes.sharpness[:, index] = changed.sharpness[:, 0]
            lobes.amplitude[:, index] = changed.amplitude[:, 0]
    return lobes, changes


def _words(view: View, was: LobeLights, held: LobeLights) -> list[str]:
    """Say what differs."""
    words = []
    if held.turn is not None:
        moved = _largest_turn_deg(held.turn)
        words += [f"turned by {moved:.3g} degrees"] if moved > TURNED_DEG else []
    for k, name in enumerate(view.size_names):
        words += _factor(name.removeprefix("inputs:"), was.sizes[:, k], held.sizes[:, k])
    brightness = [light.max(-1) for light in (was.light, held.light)]
    words += _factor("light", *brightness)
    tint = [
        light / np.maximum(most, np.finfo(float).tiny)[:, None]
        for light, most in zip((was.light, held.light), brightness, strict=True)
    ]
    lit = (brightness[0] > 0) & (brightness[1] > 0)
    if bool((np.abs(tint[0] - tint[1])[lit] > EDITED).any()):
        words.append("another colour")
    return [*words, *held.apart]


def _factor(name: str, was: Array, held: Array) -> list[str]:
    """Say by how much a value is larger, over the frames; nothing where it is the same.  [F]."""
    if not bool((np.abs(held - was) > EDITED * np.abs(was)).any()):
        return []
    lit = was > 0
    if not bool(lit.any()):
        return [f"{name} from 0 to {held.max():.3g}"]
    ratio = held[lit] / was[lit]
    low, high = float(ratio.min()), float(ratio.max())
    span = f"{high:.3g}" if high - low <= EDITED * high else f"{low:.3g} to {high:.3g}"
    return [f"{name} x {span}"]


def _largest_turn_deg(turns: Array) -> float:
    cosine = (np.trace(turns, axis1=1, axis2=2) - 1) / 2
    return math.degrees(math.acos(float(np.clip(cosine.min(), -1, 1))))


def _changed(view: View, own: Lobes, was: LobeLights, held: LobeLights, derived: Derived) -> Lobes:
    """Return the lobe whose lights are the edited ones.  [F, 1, .]."""
    if held.turn is not None:
        own = replace(own, axes=own.axes @ torch.from_numpy(held.turn)[:, None])
    resized = np.any(np.abs(held.sizes - was.sizes) > EDITED * was.sizes, axis=-1, keepdims=True)
    if resized.any():
        own = replace(own, sharpness=_sharpness(view, own, held.sizes, resized, derived))
    relit = resized | (np.abs(held.light - was.light) > EDITED * was.light)
    unit = replace(own, amplitude=torch.ones_like(own.amplitude))
    per_amplitude = derived(unit).light  # light is in proportion to the amplitude
    amplitude = torch.from_numpy(held.light / per_amplitude)[:, None]
    changed = torch.from_numpy(relit.any(-1))[:, None, None]
    return replace(own, amplitude=torch.where(changed, amplitude.clamp(min=0), own.amplitude))


def _sharpness(
    view: View, own: Lobes, sizes: Array, resized: NDArray[np.bool_], derived: Derived
) -> Tensor:
    """Return the sharpness with which the derived sizes are the edited ones.  [F, 1, 2]."""
    low, high = SHARPNESS_RANGE
    found = own.sharpness
    tiny = np.finfo(float).tiny
    for _ in range(STEPS):
        now = derived(replace(own, sharpness=found)).sizes
        ratio = view.spread(now) / np.maximum(view.spread(sizes), tiny)
        ratio = torch.from_numpy(ratio)[:, None]
        if own.form is Form.SG:  # one sharpness for both
            ratio = ratio.log().mean(-1, keepdim=True).exp()
        found = (found * ratio).clamp(low, high)
    return torch.where(torch.from_numpy(resized)[:, None], found, own.sharpness)


def _with_dome(
    view: View, lobes: Lobes, name: str, shown: Sequence[bool]
) -> tuple[Lobes, list[str]]:
    """Apply the edits of a dome to the lobes that it shows."""
    dome = view.rig.GetChild(name)
    if not dome or dome.GetTypeName() != schema.LIGHT_TYPES[Representation.DOME]:
        where = f"{view.rig.GetPath()}: has no DomeLight"
        return lobes, [f"{where}; its lobes are as they were"]
    own = torch.tensor(list(shown))[:, None]
    light = view.brightness(dome) * ~view.hidden(dome)[:, None]
    words = _factor("light", np.ones(len(light)), light.max(-1))
    words += ["another colour"] if np.ptp(light, axis=-1).max() > EDITED else []
    if words:
        scaled = lobes.amplitude * torch.from_numpy(light)[:, None]
        lobes = replace(lobes, amplitude=torch.where(own, scaled, lobes.amplitude))
    upright = dome.GetAttribute(schema.ROTATE_DOME)
    authored = Gf.Matrix4d(1)
    if upright and upright.Get() is not None:
        authored.SetRotate(Gf.Rotation(Gf.Vec3d.XAxis(), upright.Get()))
    turns = _turns(lambda cache: cache.ComputeRelativeTransform(dome, view.rig)[0], view.times)
    turns = np.array(authored)[:3, :3].T @ turns
    if (moved := _largest_turn_deg(turns)) > TURNED_DEG:
        words.append(f"turned by {moved:.3g} degrees")
        turned = lobes.axes @ torch.from_numpy(turns)[:, None]
        lobes = replace(lobes, axes=torch.where(own[..., None], turned, lobes.axes))
    return lobes, [f"{dome.GetPath()}: {', '.join(words)}"] if words else []


def _turned_rig(rig: Usd.Prim, lobes: Lobes, times: tuple[int, ...]) -> tuple[Lobes, list[str]]:
    """Turn the lobes with the rig; its place does not matter to a light that is far."""
    turns = _turns(lambda cache: cache.GetLocalToWorldTransform(rig), times)
    moved = _largest_turn_deg(turns)
    if moved <= TURNED_DEG:
        return lobes, []
    turned = replace(lobes, axes=lobes.axes @ torch.from_numpy(turns)[:, None])
    return turned, [f"{rig.GetPath()}: turned by {moved:.3g} degrees with all its lobes"]


def _turns(matrix: Callable[[UsdGeom.XformCache], Gf.Matrix4d], times: tuple[int, ...]) -> Array:
    """Return the rotation in a transform at every frame, for row vectors.  [F, 3, 3]."""
    cache, found = UsdGeom.XformCache(), []
    for time in times:
        cache.SetTime(time)
        rows = torch.from_numpy(np.array(matrix(cache))[:3, :3].copy())
        found.append(frames.orthonormal(rows).numpy())
    return np.stack(found)


def _with_visibility(
    prims: Sequence[Usd.Prim], lobes: Lobes, times: tuple[int, ...]
) -> tuple[Lobes, list[str]]:
    """Make lobes black where nobody sees them."""
    amplitude, changes = lobes.amplitude.clone(), []
    for index, prim in enumerate(prims):
        chain = [prim.GetStage().GetPrimAtPath(path) for path in prim.GetPath().GetPrefixes()]
        if not any(one.GetAttribute("visibility").HasAuthoredValue() for one in chain):
            continue
        image = UsdGeom.Imageable(prim)
        hidden = [image.ComputeVisibility(time) == UsdGeom.Tokens.invisible for time in times]
        amplitude[torch.tensor(hidden), index] = 0
        if any(hidden):
            where = "" if all(hidden) else f" in {sum(hidden)} of {len(times)} frames"
            changes.append(f"{prim.GetPath()}: invisible{where}")
    return replace(lobes, amplitude=amplitude), changes
