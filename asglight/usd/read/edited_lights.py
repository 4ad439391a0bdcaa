# SPDX-License-Identifier: Apache-2.0
"""Lights that were edited in another program, turned back into lobes.

A stage says the same thing twice: what a lobe is, and the lights derived from it. Other programs
know lights only. So the lights of the representation that is shown are compared with those that
`write_usd` would author, and where they differ the lobe is changed to one whose lights they are:

- direction and turn: by the rotation from the authored light's frame to the edited one's; a card
  stands where its centre is seen from the rig's origin;
- sharpness: so that the derived sizes are the edited ones; a card's size scales with its distance;
- amplitude: so that the derived light is the edited one, in each channel;
- a lobe whose light is gone is black; those that are invisible `hidden_lobes` tells;
- a dome that was turned turns its lobes;
- how the rig stands in the shot turns all lobes (placement.py).

A lobe whose own attributes were overridden is what they say, whatever its lights are: its digest
(asglight.usd.digest) is no longer that of what was written.

Dimension letters: F frames, N lobes.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from pxr import Gf, Usd, UsdGeom, UsdLux
from torch import Tensor

from asglight.lobes import Form, Lobes
from asglight.usd import schema
from asglight.usd.digest import has_own_edits
from asglight.usd.lights.cards import Kind
from asglight.usd.options import KeyLights
from asglight.usd.read.held_lights import EDITED, Array, LobeLights, Written, held_lights
from asglight.usd.read.placement import Placement, turn_words, turned_or_mirrored
from asglight.usd.read.read_options import card_kinds, threefold_lobes
from asglight.usd.read.view import View
from asglight.usd.schema import Representation
from asglight.usd.stage import child_of, key_lights, prims_below, shown_representation
from asglight.usd.write.checks import SHARPNESS_RANGE

STEPS = 40
"""Of the fixed point from sizes to sharpness: narrow lobes, whose squared sines are in inverse
proportion to it, need one; broad ones, whose sines change less, the more."""

RESLANTED = 0.02
"""Of each number of a slant, about a degree: what is told of as an edit."""

Derived = Callable[[Lobes], LobeLights]
"""From a lobe to its lights, taken together as those that were written."""


def with_light_edits(
    rig: Usd.Prim,
    prims: Sequence[Usd.Prim],
    lobes: Lobes,
    times: tuple[int, ...],
    distance: float,
    placement: Placement,
    colorspace: str,
) -> tuple[Lobes, list[str]]:
    """Return the lobes that the shown representation's lights say, as asglight has them turned.

    Those that are invisible have their light: `hidden_lobes` tells which they are.

    Args:
        rig: The prim that holds the lobes.
        prims: Those of the lobes.
        lobes: As their own attributes say, in the rig's space.  [F, N, .]
        times: Frame numbers.
        distance: Of the cards as written.
        placement: How the rig stands in the stage.
        colorspace: Color Interop ID of the rig's colours.

    Returns:
        The lobes, and what was changed, one line each: `<prim>: <what>`.
    """
    representation = shown_representation(rig)
    changes = switched_off(rig, schema.LOBES)
    lobes = lobes.to(torch.float64)
    if representation not in (None, Representation.KEYS):  # keys are read by themselves
        kinds, threefold = card_kinds(rig), threefold_lobes(rig)
        view = View(rig, times, representation, distance, placement, colorspace, kinds, threefold)
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
    changes += [f"{rig.GetPath()}: {word}" for word in placement.words()]
    return turned_or_mirrored(lobes, placement.to_world).to(torch.float32), changes


def switched_off(rig: Usd.Prim, scope: str) -> list[str]:
    """Return a line for each lobe of a rig that is inactive, or for each key."""
    every = child_of(rig, scope).GetAllChildren() if child_of(rig, scope) else ()
    return [f"{prim.GetPath()}: switched off" for prim in every if not prim.IsActive()]


def with_key_edits(
    rig: Usd.Prim,
    prims: Sequence[Usd.Prim],
    lobes: Lobes,
    times: tuple[int, ...],
    distance: float,
    placement: Placement,
    colorspace: str,
) -> tuple[Lobes, list[str]]:
    """Return the lobes that the lights of keys say; arguments and result as `with_light_edits`.

    Args:
        rig: The prim that holds the keys.
        prims: Those of the keys, of which there is one at least.
        lobes: As their own attributes say.  [F, K, .]
        times: Frame numbers.
        distance: Of the lights as written.
        placement: How the rig stands in the stage.
        colorspace: Color Interop ID of the rig's colours.
    """
    is_distant = key_lights(prims) is KeyLights.DISTANT
    shown = Representation.DISTANT if is_distant else Representation.CARDS
    kinds, threefold = [Kind.SINGLE] * len(prims), [False] * len(prims)
    view = View(rig, times, shown, distance, placement, colorspace, kinds, threefold)
    lobes, changes = _with_lights(view, prims, lobes.to(torch.float64))
    return turned_or_mirrored(lobes, placement.to_world).to(torch.float32), changes


def _with_lights(view: View, prims: Sequence[Usd.Prim], lobes: Lobes) -> tuple[Lobes, list[str]]:
    changes: list[str] = []
    authored = view.lights(lobes, range(len(prims)))
    lobes = lobes.clone()
    for index, prim in enumerate(prims):
        if not authored[index] or has_own_edits(prim):
            continue
        own = lobes.select(torch.tensor([index]))
        written = Written.of(view, prim, authored[index])
        held = held_lights(prim, own, written)
        if held is None:
            kind = schema.LIGHT_TYPES[view.representation]
            is_other = any(one.HasAPI(UsdLux.LightAPI) for one in prims_below(prim))
            lobes.amplitude[:, index] *= is_other
            then = "its lobe is as it was" if is_other else "so it is black"
            changes.append(f"{prim.GetPath()}: has no {kind}; {then}")
            continue
        was = written.together(written.lights)
        words = _words(view, was, held, written.sampled)
        words += _slant_words(own, held, written.sampled)
        if words:
            changes.append(f"{prim.GetPath()}: {', '.join(words)}")

            def derived(lobe: Lobes, index: int = index, written: Written = written) -> LobeLights:
                return written.together(view.lights(lobe, [index])[0])

            changed = _changed(view, own, was, held, derived)
            lobes.axes[:, index] = changed.axes[:, 0]
            lobes.sharpness[:, index] = changed.sharpness[:, 0]
            lobes.amplitude[:, index] = changed.amplitude[:, 0]
            if lobes.slant is not None and changed.slant is not None:
                lobes.slant[:, index] = changed.slant[:, 0]
    return lobes, changes


def _words(view: View, was: LobeLights, held: LobeLights, written: NDArray[np.bool_]) -> list[str]:
    """Say what differs in the frames that were written."""
    words = []
    if held.turn is not None:
        words += turn_words(held.turn[written])
    for k, name in enumerate(view.size_names):
        sizes = was.sizes[written, k], held.sizes[written, k]
        words += _factor(name.removeprefix("inputs:"), *sizes)
    brightness = [light.max(-1) for light in (was.light[written], held.light[written])]
    words += _factor("light", *brightness)
    tint = [
        light / np.maximum(most, np.finfo(float).tiny)[:, None]
        for light, most in zip((was.light[written], held.light[written]), brightness, strict=True)
    ]
    lit = (brightness[0] > 0) & (brightness[1] > 0)
    if bool((np.abs(tint[0] - tint[1])[lit] > EDITED).any()):
        words.append("another colour")
    return [*words, *held.apart]


def _slant_words(own: Lobes, held: LobeLights, written: NDArray[np.bool_]) -> list[str]:
    """Say that a key stands otherwise than it did."""
    if held.slant is None or own.slant is None:
        return []
    off = np.abs(held.slant - own.slant[:, 0].numpy())[written]
    return ["slanted otherwise"] if float(off.max()) > RESLANTED else []


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


def _changed(view: View, own: Lobes, was: LobeLights, held: LobeLights, derived: Derived) -> Lobes:
    """Return the lobe whose lights are the edited ones.  [F, 1, .]."""
    if held.turn is not None:
        own = replace(own, axes=own.axes @ torch.from_numpy(held.turn)[:, None])
    resized = np.any(np.abs(held.sizes - was.sizes) > EDITED * was.sizes, axis=-1, keepdims=True)
    if held.slant is not None:
        own = replace(own, slant=torch.from_numpy(held.slant)[:, None])
        resized = np.ones_like(resized)
    if resized.any():
        own = replace(own, sharpness=_sharpness(view, own, held.sizes, resized, derived))
    light_changed = resized | (np.abs(held.light - was.light) > EDITED * was.light)
    unit = replace(own, amplitude=torch.ones_like(own.amplitude))
    per_amplitude = derived(unit).light  # light is in proportion to the amplitude
    amplitude = torch.from_numpy(held.light / per_amplitude)[:, None]
    changed = torch.from_numpy(light_changed.any(-1))[:, None, None]
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
    dome = child_of(view.rig, name)
    own = torch.tensor(list(shown))[:, None]
    if not dome or not dome.IsActive():
        lobes = replace(lobes, amplitude=torch.where(own, 0.0, lobes.amplitude))
        path = view.rig.GetPath().AppendChild(name)
        return lobes, [f"{path}: {'switched off' if dome else 'is gone'}, so its lobes are black"]
    if dome.GetTypeName() != schema.LIGHT_TYPES[Representation.DOME]:
        return lobes, [f"{dome.GetPath()}: is no DomeLight; its lobes are as they were"]
    found = dome_edits(view, dome)
    words = found.words
    if found.dimmed:
        scaled = lobes.amplitude * torch.from_numpy(found.light)[:, None]
        lobes = replace(lobes, amplitude=torch.where(own, scaled, lobes.amplitude))
    if found.turned:
        axes = torch.where(own[..., None], turned_or_mirrored(lobes, found.turns).axes, lobes.axes)
        lobes = replace(lobes, axes=axes)
    return lobes, [f"{dome.GetPath()}: {', '.join(words)}"] if words else []


class DomeEdits(NamedTuple):
    """What another program changed in a dome.

    Attributes:
        light: What its images are multiplied by.  [F, 3]
        turns: How it is turned in the rig, orthogonal, for row vectors.  [F, 3, 3]
        dimmed: What is said of its light.
        turned: What is said of its turn.
    """

    light: Array
    turns: Array
    dimmed: list[str]
    turned: list[str]

    @property
    def words(self) -> list[str]:
        """Return all that is said."""
        return [*self.dimmed, *self.turned]


def dome_edits(view: View, dome: Usd.Prim) -> DomeEdits:
    """Find what another program changed in a dome that is there."""
    light = view.brightness(dome) * ~view.hidden(dome)[:, None]
    dimmed = _factor("light", np.ones(len(light)), light.max(-1))
    dimmed += ["another colour"] if np.ptp(light, axis=-1).max() > EDITED else []
    left, _, right = np.linalg.svd(view.placement.relative(view.world(dome))[:, :3])
    turns = upright(dome)[:3, :3].T @ (left @ right)
    return DomeEdits(light, turns, dimmed, turn_words(turns))


def upright(dome: Usd.Prim) -> Array:
    """Return the turn by which a dome stands upright in its stage, for row vectors.  [4, 4]."""
    authored, value = Gf.Matrix4d(1), dome.GetAttribute(schema.ROTATE_DOME)
    if value and value.Get() is not None:
        authored.SetRotate(Gf.Rotation(Gf.Vec3d.XAxis(), value.Get()))
    return np.array(authored)


def hidden_lobes(prims: Sequence[Usd.Prim], times: tuple[float, ...]) -> tuple[Tensor, list[str]]:
    """Return where lobes are invisible, and what is to be said of that.

    Args:
        prims: Those of the lobes.
        times: Time codes.

    Returns:
        Whether nobody sees a lobe, [F, N], and one line for each lobe of which that is so.
    """
    found, changes = torch.zeros(len(times), len(prims), dtype=torch.bool), []
    for index, prim in enumerate(prims):
        chain = [prim.GetStage().GetPrimAtPath(path) for path in prim.GetPath().GetPrefixes()]
        if not any(one.GetAttribute(schema.VISIBILITY).HasAuthoredValue() for one in chain):
            continue
        image = UsdGeom.Imageable(prim)
        hidden = [image.ComputeVisibility(time) == UsdGeom.Tokens.invisible for time in times]
        found[:, index] = torch.tensor(hidden)
        if any(hidden):
            where = "" if all(hidden) else f" in {sum(hidden)} of {len(times)} frames"
            changes.append(f"{prim.GetPath()}: invisible{where}")
    return found, changes
