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
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux
from torch import Tensor

from asglight.lobes import Form, Lobes, frames
from asglight.usd import cards, distant, schema
from asglight.usd.checks import SHARPNESS_RANGE
from asglight.usd.digest import has_own_edits
from asglight.usd.schema import Representation
from asglight.usd.stage import numbers

EDITED = 1e-3
"""Relative. Programs write four digits or more, and nobody sees less; samples that were left out
cost a fiftieth of it."""

TURNED_DEG = 0.01
"""Of a light whose transform is not the authored one: float32 matrices keep a hundredth of that."""

STEPS = 40
"""Of the fixed point from sizes to sharpness: narrow lobes, whose squared sines are in inverse
proportion to it, need one; broad ones, whose sines change less, the more."""

Array = NDArray[np.float64]


@dataclass(frozen=True)
class _Lights:
    """The lights of one lobe that share its edits.

    Attributes:
        sizes: Width and height, or the angle.  [F, 1 or 2]
        light: Radiance or irradiance.  [F, 3]
        turn: From the authored frame to the edited one, for row vectors.  [F, 3, 3]
    """

    sizes: Array
    light: Array
    turn: Array | None = None


@dataclass(frozen=True)
class _View:
    """What is looked at.

    Attributes:
        rig: The prim that holds the lobes.
        times: Frame numbers.  F
        representation: The variant that is selected.
        distance: Of the cards as written.
        form: Of the lobes.
    """

    rig: Usd.Prim
    times: tuple[int, ...]
    representation: Representation
    distance: float
    form: Form

    @property
    def size_names(self) -> tuple[str, ...]:
        """Return the attributes that say how large a light is."""
        is_card = self.representation is Representation.CARDS
        return (schema.WIDTH, schema.HEIGHT) if is_card else (schema.ANGLE,)

    def spread(self, sizes: Array) -> Array:
        """Return the squared sines of half the angles that lights are seen under.  [F, 1 or 2]."""
        if self.representation is Representation.CARDS:
            squares = (sizes / (2 * self.distance)) ** 2
            return squares / (1 + squares)
        return np.sin(np.radians(np.minimum(sizes, 180.0)) / 2) ** 2

    def authored(self, lobes: Lobes) -> tuple[Array, Array]:
        """Return sizes [F, N, 1 or 2] and light [F, N, 3] that `write_usd` would author."""
        if self.representation is Representation.CARDS:
            found = cards.values(lobes, self.distance)
        else:
            found = distant.values(lobes)
        sizes = torch.cat([found[name] for name in self.size_names], -1)
        return sizes.numpy(), (found[schema.INTENSITY] * found[schema.COLOR]).numpy()

    def values(self, prim: Usd.Prim, name: str, fallback: object) -> Array:
        """Return an attribute at every frame, or what stands for one without a value.  [F, K]."""
        attribute = prim.GetAttribute(name)
        query = Usd.AttributeQuery(attribute) if attribute else None
        varies = query is not None and query.ValueMightBeTimeVarying()
        times = self.times if varies else self.times[:1]
        found = [query.Get(time) if query else None for time in times]
        rows = [fallback if value is None else value for value in found]
        kind = Sdf.ValueTypeNames.Color3f if name == schema.COLOR else Sdf.ValueTypeNames.Float
        return np.repeat(numbers(rows, kind), 1 if varies else len(self.times), axis=0)


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
        view = _View(rig, times, Representation(selected), distance, lobes.form)
        if view.representation is Representation.DOME:
            lobes, found = _with_dome(view, lobes)
        else:
            lobes, found = _with_lights(view, prims, lobes)
        changes += found
    lobes, found = _with_visibility(prims, lobes, times)
    changes += found
    lobes, found = _turned_rig(rig, lobes, times)
    return lobes.to(torch.float32), changes + found


def _with_lights(view: _View, prims: Sequence[Usd.Prim], lobes: Lobes) -> tuple[Lobes, list[str]]:
    sizes, light = view.authored(lobes)
    changes: list[str] = []
    lobes = lobes.clone()
    for index, prim in enumerate(prims):
        if has_own_edits(prim):
            continue
        own = lobes.select(torch.tensor([index]))
        held = _held(view, prim, own)
        if held is None:
            kind = schema.LIGHT_TYPES[view.representation]
            changes.append(f"{prim.GetPath()}: has no {kind}; its lobe is as it was")
            continue
        was = _Lights(sizes[:, index], light[:, index])
        words = _words(view, was, held)
        if words:
            changes.append(f"{prim.GetPath()}: {', '.join(words)}")
            changed = _changed(view, own, was, held)
            lobes.axes[:, index] = changed.axes[:, 0]
            lobes.sharpness[:, index] = changed.sharpness[:, 0]
            lobes.amplitude[:, index] = changed.amplitude[:, 0]
    return lobes, changes


def _held(view: _View, prim: Usd.Prim, own: Lobes) -> _Lights | None:
    """Return what the lights of a lobe are now, or None where it has none of their kind.

    Of two sides the light is the mean, and the first stands for place and size.
    """
    kind = schema.LIGHT_TYPES[view.representation]
    found = [child for child in Usd.PrimRange(prim) if child.GetTypeName() == kind]
    if not found:
        return None
    turn, stretch = _placed(view, prim, found[0], own)
    sizes = np.concatenate([view.values(found[0], name, 1.0) for name in view.size_names], -1)
    light = np.mean([_light(view, one, sizes) for one in found], axis=0)
    return _Lights(sizes * stretch[:, : sizes.shape[-1]], light, turn)


def _light(view: _View, light: Usd.Prim, sizes: Array) -> Array:
    """Return radiance of a card, irradiance of a distant light, whatever says it.  [F, 3]."""
    value = (
        view.values(light, schema.INTENSITY, 1.0)
        * view.values(light, schema.COLOR, Gf.Vec3f(1))
        * 2.0 ** view.values(light, schema.EXPOSURE, 0.0)
    )
    normalized = bool(UsdLux.LightAPI(light).GetNormalizeAttr().Get())
    if view.representation is Representation.CARDS:
        return value / sizes.prod(-1, keepdims=True) if normalized else value
    disc = np.pi * np.sin(np.radians(np.minimum(sizes, 180.0)) / 2) ** 2
    return value if normalized else value * disc


def _placed(view: _View, prim: Usd.Prim, light: Usd.Prim, own: Lobes) -> tuple[Array | None, Array]:
    """Return how a light was turned, and how much larger it is seen than its size says.

    Returns:
        The turn [F, 3, 3], None where the transform is as authored; factors of the sizes [F, 2].
    """
    count = len(view.times)
    is_card = view.representation is Representation.CARDS
    if _is_as_authored(view, prim, light):
        return None, np.ones((count, 2))
    cache, turns, stretch = UsdGeom.XformCache(), [], np.ones((count, 2))
    for index, time in enumerate(view.times):
        cache.SetTime(time)
        matrix, _ = cache.ComputeRelativeTransform(light, view.rig)
        rows = np.array(matrix)
        x, y, z, place = rows[:, :3]
        far = float(np.linalg.norm(place))
        if is_card and far > 0:
            z = place
            stretch[index] = np.linalg.norm([x, y], axis=-1) * view.distance / far
        frame = frames.orthonormal(torch.from_numpy(np.stack([x, y, z]))).numpy()
        turns.append(own.axes[index, 0].numpy().T @ frame)
    return np.stack(turns), stretch


def _is_as_authored(view: _View, prim: Usd.Prim, light: Usd.Prim) -> bool:
    """Tell whether a light's transform is the lobe's own and, of a card, the written distance."""
    is_card = view.representation is Representation.CARDS
    own = [schema.ORIENT] if light == prim else []
    wanted = [*own, schema.TRANSLATE] if is_card else own
    above = [schema.ORIENT] if light != prim else wanted
    found = [list(p.GetAttribute(schema.OP_ORDER).Get() or ()) for p in (light, prim)]
    offset = light.GetAttribute(schema.TRANSLATE)
    still = not is_card or (
        bool(offset)
        and not offset.GetTimeSamples()
        and offset.Get() == Gf.Vec3d(0, 0, view.distance)
    )
    return found == [wanted, above] and still


def _words(view: _View, was: _Lights, held: _Lights) -> list[str]:
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
    return words


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


def _changed(view: _View, own: Lobes, was: _Lights, held: _Lights) -> Lobes:
    """Return the lobe whose lights are the edited ones.  [F, 1, .]."""
    if held.turn is not None:
        own = replace(own, axes=own.axes @ torch.from_numpy(held.turn)[:, None])
    resized = np.any(np.abs(held.sizes - was.sizes) > EDITED * was.sizes, axis=-1, keepdims=True)
    if resized.any():
        own = replace(own, sharpness=_sharpness(view, own, held.sizes, resized))
    relit = resized | (np.abs(held.light - was.light) > EDITED * was.light)
    unit = replace(own, amplitude=torch.ones_like(own.amplitude))
    _, per_amplitude = view.authored(unit)  # light is in proportion to the amplitude
    amplitude = torch.from_numpy(held.light[:, None] / per_amplitude)
    changed = torch.from_numpy(relit.any(-1))[:, None, None]
    return replace(own, amplitude=torch.where(changed, amplitude.clamp(min=0), own.amplitude))


def _sharpness(view: _View, own: Lobes, sizes: Array, resized: NDArray[np.bool_]) -> Tensor:
    """Return the sharpness with which the derived sizes are the edited ones.  [F, 1, 2]."""
    low, high = SHARPNESS_RANGE
    found = own.sharpness
    tiny = np.finfo(float).tiny
    for _ in range(STEPS):
        derived, _ = view.authored(replace(own, sharpness=found))
        ratio = view.spread(derived[:, 0]) / np.maximum(view.spread(sizes), tiny)
        ratio = torch.from_numpy(ratio)[:, None]
        if own.form is Form.SG:  # one sharpness for both
            ratio = ratio.log().mean(-1, keepdim=True).exp()
        found = (found * ratio).clamp(low, high)
    return torch.where(torch.from_numpy(resized)[:, None], found, own.sharpness)


def _with_dome(view: _View, lobes: Lobes) -> tuple[Lobes, list[str]]:
    """Apply the edits of the dome, which shows all lobes."""
    dome = view.rig.GetChild(schema.DOME)
    if not dome or dome.GetTypeName() != schema.LIGHT_TYPES[Representation.DOME]:
        return lobes, [f"{view.rig.GetPath()}: has no DomeLight; its lobes are as they were"]
    light = (
        view.values(dome, schema.INTENSITY, 1.0)
        * view.values(dome, schema.COLOR, Gf.Vec3f(1))
        * 2.0 ** view.values(dome, schema.EXPOSURE, 0.0)
    )
    words = _factor("light", np.ones(len(light)), light.max(-1))
    words += ["another colour"] if np.ptp(light, axis=-1).max() > EDITED else []
    if words:
        lobes = replace(lobes, amplitude=lobes.amplitude * torch.from_numpy(light)[:, None])
    upright = dome.GetAttribute(schema.ROTATE_DOME)
    authored = Gf.Matrix4d(1)
    if upright and upright.Get() is not None:
        authored.SetRotate(Gf.Rotation(Gf.Vec3d.XAxis(), upright.Get()))
    turns = _turns(lambda cache: cache.ComputeRelativeTransform(dome, view.rig)[0], view.times)
    turns = np.array(authored)[:3, :3].T @ turns
    if (moved := _largest_turn_deg(turns)) > TURNED_DEG:
        words.append(f"turned by {moved:.3g} degrees")
        lobes = replace(lobes, axes=lobes.axes @ torch.from_numpy(turns)[:, None])
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
