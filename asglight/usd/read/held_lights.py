# SPDX-License-Identifier: Apache-2.0
"""What the lights of a lobe are in a stage, beside what `write_usd` would author.

A lobe may have several lights: three cards, three distant lights, and for the bingham form those of
both sides. They are taken together, by one size, one light and one turn: means by shares that stay
those of the written lights. So what was done to all of them alike counts as it is, and what was
done to one of three cards by its share of the flux.

Dimension letters: F frames, L lights of a lobe, S sizes.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
import torch
from numpy.typing import NDArray
from pxr import Gf, Usd, Vt

from asglight.lobes import Lobes, frames
from asglight.lobes.data import SLANT
from asglight.lobes.rectangles import seen_as, slant_of
from asglight.usd import schema
from asglight.usd.lights import cards
from asglight.usd.lights.light import Light
from asglight.usd.read.seen_cards import seen_from_origin, seen_rectangles
from asglight.usd.read.view import View
from asglight.usd.stage import DamagedValueError, prims_below

EDITED = 7e-3
"""Relative. Light edits are seen from a few percent on. Where a shot runs slower its frames lie
between those of the rig, and there both a light and its lobe may be off by 3e-3."""

LIGHT_MIN = 1e-37
"""Of a channel of a light; less counts as none. Below it come the numbers of float32 that have few
digits, which are `EDITED` apart and more."""

SIDE_MOVED = 2e-3
"""Of a component of the quaternion that tilts an outer distant light. The tilt is the root of a
difference of mean squares: where a lobe is nearly round, the 3e-6 of it that samples may be off
tilt by 2e-3, a component by half as much."""

SLANTED = 1e-3
"""Of each number of a slant: less is the rounding of a card that faces the origin."""

APART_DEG = 0.5
"""Between the turns of a lobe's lights; two of SIDE_MOVED."""

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LobeLights:
    """The lights of one lobe, taken together.

    Attributes:
        sizes: Width and height, or the angle: geometric mean.  [F, S]
        light: Radiance or irradiance: mean.  [F, 3]
        turn: From the authored frame to the edited one, for row vectors; None where the transforms
            are as authored.  [F, 3, 3]
        apart: What was done to some of the lights only, in words.
        slant: Of a key that is not as authored, how its card stands in the frame so turned.  [F, 7]
    """

    sizes: Array
    light: Array
    turn: Array | None = None
    apart: tuple[str, ...] = ()
    slant: Array | None = None


@dataclass(frozen=True)
class Written:
    """The lights that `write_usd` would author for one lobe.

    Attributes:
        view: What is looked at.
        lights: L of them.
        shares: Of each in the means.  [F, L]
        sampled: In which frames the lobe or a light of its has samples.  [F]
    """

    view: View
    lights: Sequence[Light]
    shares: Array
    sampled: NDArray[np.bool_]

    @classmethod
    def of(cls, view: View, prim: Usd.Prim, lights: Sequence[Light]) -> Self:
        """Take a lobe's lights: cards by their solid angles, distant lights alike."""
        weights = np.ones((len(view.times), len(lights)))
        if view.is_cards and len(lights) > 1:
            for index, light in enumerate(lights):
                extent = _sizes(view, light) / (2 * light.constants[schema.TRANSLATE][2])
                weights[:, index] = cards.solid_angle(torch.from_numpy(extent)).numpy()
        shares = weights / weights.sum(-1, keepdims=True)
        return cls(view, lights, shares, view.sampled(prim))

    def together(self, lights: Sequence[Light]) -> LobeLights:
        """Return other lights of the same kinds, taken together as these."""
        sizes = np.stack([_sizes(self.view, light) for light in lights], 1)
        light = np.stack([_brightness(light) for light in lights], 1)
        return self.mean(sizes, light)

    def mean(
        self,
        sizes: Array,
        light: Array,
        turn: Array | None = None,
        apart: tuple[str, ...] = (),
    ) -> LobeLights:
        """Return the means of sizes [F, L, S] and light [F, L, 3]."""
        shares = self.shares[..., None]
        logs = np.log(np.maximum(sizes, np.finfo(float).tiny))
        whole = np.exp((shares * logs).sum(1))
        return LobeLights(whole, (shares * light).sum(1), turn, apart)


def held_lights(prim: Usd.Prim, own: Lobes, written: Written) -> LobeLights | None:
    """Return what the lights of a lobe are now, or None where it has none of their kind.

    Args:
        prim: The lobe's.
        own: The lobe.  [F, 1, .]
        written: Its lights as they would be authored.
    """
    view = written.view
    found = _found(view, prim, written.lights)
    if not any(found):
        return None
    if view.is_cards and own.slant is not None and found[0]:
        return _held_key(view, prim, found[0], own, written.lights[0])
    sizes, light, turns = [], [], []
    for one, authored in zip(found, written.lights, strict=True):
        size, value, turn = _sizes(view, authored), np.zeros((len(view.times), 3)), None
        if one:
            size, value, turn = _met(view, prim, one, own, authored)
            if one != prim:  # a hidden lobe is told of as such
                value = value * ~view.hidden(one)[:, None]
        sizes.append(size)
        light.append(value)
        turns.append(turn)
    absent = [light.name for one, light in zip(found, written.lights, strict=True) if not one]
    apart = [f"without {name}" for name in absent]
    mean_turn, between = _together(turns, written.shares)
    stacked = np.stack(sizes, 1), np.stack(light, 1)
    turned_apart = bool((between[written.sampled] < 1 + 2 * np.cos(np.radians(APART_DEG))).any())
    if not absent and (turned_apart or _differ(written, *stacked)):
        apart.append(f"its {len(found)} lights differ, their mean counts")
    return written.mean(*stacked, mean_turn, tuple(apart))


def _sizes(view: View, light: Light) -> Array:
    return torch.cat([light.tracks[name] for name in view.size_names], -1).numpy()


def _brightness(light: Light) -> Array:
    return _lit((light.tracks[schema.INTENSITY] * light.tracks[schema.COLOR]).numpy())


def _lit(light: Array) -> Array:
    return np.where(light < LIGHT_MIN, 0.0, light)


def _found(view: View, prim: Usd.Prim, lights: Sequence[Light]) -> list[Usd.Prim | None]:
    """Return the prims of a lobe's lights; one alone may have been moved below its lobe."""
    kind = schema.LIGHT_TYPES[view.representation]
    below = {
        one.GetName() if one != prim else "": one
        for one in prims_below(prim)
        if one.GetTypeName() == kind
    }
    if len(lights) == 1 and below:
        return [next(iter(below.values()))]
    return [below.get(light.name) for light in lights]


def _light(view: View, light: Usd.Prim, sizes: Array) -> Array:
    """Return radiance of a card, irradiance of a distant light, whatever says it.  [F, 3].

    A normalised light is divided by the area that it has in the stage, or by what a distant light's
    radiance is multiplied by to be irradiance (UsdLux, Normalizing Distant Lights); one of no
    extent is not normalised.
    """
    value = view.brightness(light)
    normalized = view.values(light, schema.NORMALIZE, False) > 0
    if view.is_cards:
        lengths = np.linalg.norm(view.world(light)[:, :2, :3], axis=-1)
        area = (sizes * lengths).prod(-1, keepdims=True)
        return np.where(normalized, value / np.maximum(area, np.finfo(float).tiny), value)
    half = np.radians(np.clip(sizes, 0.0, 360.0)) / 2
    sine = np.pi * np.sin(half) ** 2
    disc = np.where(half > np.pi / 2, 2 * np.pi - sine, np.where(half > 0, sine, 1.0))
    return np.where(normalized, value, value * disc)


def _differ(written: Written, sizes: Array, light: Array) -> bool:
    """Tell whether lights were edited in different ways in frames with samples.  [F, L, .]."""
    was = [np.stack([_sizes(written.view, one) for one in written.lights], 1)]
    was.append(np.stack([_brightness(one) for one in written.lights], 1))
    for before, after in zip(was, (sizes, light), strict=True):
        lit = (before > 0).all(1)
        ratio = after / np.where(before > 0, before, 1.0)
        apart = np.ptp(ratio, axis=1) > EDITED * np.maximum(ratio.max(1), 1.0)
        if bool((apart & lit)[written.sampled].any()):
            return True
    return False


def _together(turns: Sequence[Array | None], shares: Array) -> tuple[Array | None, Array]:
    """Return the mean of turns, and the traces between it and each.  [F, 3, 3], [F, L].

    The mean is the rotation nearest to the mean of the matrices, by their singular values.
    """
    moved = [turn for turn in turns if turn is not None]
    if not moved:
        return None, np.full(shares.shape, 3.0)
    still = np.broadcast_to(np.eye(3), moved[0].shape)
    stacked = np.stack([still if turn is None else turn for turn in turns], 1)
    left, _, right = np.linalg.svd((shares[..., None, None] * stacked).sum(1))
    left[..., -1] *= np.linalg.det(left @ right)[:, None]
    mean = left @ right
    return mean, np.einsum("flij,fij->fl", stacked, mean)


def _met(
    view: View, prim: Usd.Prim, light: Usd.Prim, own: Lobes, authored: Light
) -> tuple[Array, Array, Array | None]:
    """Return what a light is met as, in the rig.

    Returns:
        Its sizes [F, S] and its light [F, 3]; its turn [F, 3, 3], None where the transform is as
        authored.
    """
    sizes = np.concatenate([view.values(light, name, 1.0) for name in view.size_names], -1)
    if not np.isfinite(sizes).all():
        raise DamagedValueError(f"{light.GetPath()} has a size that is not finite")
    value = _light(view, light, sizes)
    if not view.placement.is_stretched and _is_as_authored(view, prim, light, authored):
        return sizes, _lit(value), None
    rows = view.placement.relative(view.world(light))
    if not np.isfinite(rows).all():
        frame = view.times[int(np.flatnonzero(~np.isfinite(rows).all((-1, -2)))[0])]
        raise DamagedValueError(f"{light.GetPath()} is turned by no rotation at frame {frame}")
    axes, place = rows[:, :3], rows[:, 3]
    if view.is_cards and np.linalg.norm(place, axis=-1).min() > 0:
        seen = seen_from_origin(axes, place, sizes)
        whole = authored.constants.get(schema.TRANSLATE, (0, 0, view.distance))[2]
        sizes = 2 * seen.half_extents * whole
        frames_met, value = seen.frames, value * seen.dimming[:, None]
    else:
        frames_met = frames.orthonormal(torch.from_numpy(axes)).numpy()
    if not np.isfinite(frames_met).all():
        raise DamagedValueError(f"{light.GetPath()} is turned by no rotation")
    return sizes, _lit(value), np.swapaxes(_aimed(own, authored), -1, -2) @ frames_met


def _held_key(
    view: View, prim: Usd.Prim, light: Usd.Prim, own: Lobes, authored: Light
) -> LobeLights:
    """Return what the card of a key is met as: a rectangle that may stand anyhow.

    A parallelogram is met as the card that faces the origin and is seen alike.
    """
    sizes, value, turn = _met(view, prim, light, own, authored)
    if light != prim:
        value = value * ~view.hidden(light)[:, None]
    if turn is None:
        return LobeLights(sizes, value)
    rows = view.placement.relative(view.world(light))
    own_sizes = np.concatenate([view.values(light, name, 1.0) for name in view.size_names], -1)
    found = seen_rectangles(rows[:, :3], rows[:, 3], own_sizes)
    if found is None:
        return LobeLights(sizes, value, turn, slant=np.zeros((len(sizes), SLANT)))
    rectangle, faces = found
    axes, squares = seen_as(rectangle)
    axes = frames.align(replace(own, axes=axes[:, None], slant=None), own).axes[:, 0]
    slant = slant_of(rectangle, axes, cards.half_extent(squares)).numpy()
    slant[np.abs(slant).max(-1) < SLANTED] = 0
    turn = np.swapaxes(own.axes[:, 0].numpy(), -1, -2) @ axes.numpy()
    radiance = _lit(_light(view, light, own_sizes) * faces[:, None])
    if light != prim:
        radiance = radiance * ~view.hidden(light)[:, None]
    return LobeLights(2 * view.distance * rectangle.half.numpy(), radiance, turn, slant=slant)


def _aimed(own: Lobes, light: Light) -> Array:
    """Return the frame of an authored light, as rows in the rig's.  [F, 3, 3]."""
    aimed = own.axes[:, 0]
    if schema.ORIENT_BACK in light.ops:  # half a turn about x
        aimed = aimed * aimed.new_tensor([1.0, -1.0, -1.0])[:, None]
    if schema.ORIENT_SIDE in light.ops:
        aimed = frames.axes_from_quaternion(light.tracks[schema.ORIENT_SIDE]) @ aimed
    return aimed.numpy()


def _ops_of(prim: Usd.Prim) -> list[str]:
    value = prim.GetAttribute(schema.OP_ORDER).Get()
    return list(value) if isinstance(value, Vt.TokenArray) else []


def _is_as_authored(view: View, prim: Usd.Prim, light: Usd.Prim, authored: Light) -> bool:
    """Tell whether the transforms of a light and of its lobe are as `write_usd` authors them."""
    own = light == prim
    wanted = [*([schema.ORIENT] if own else []), *authored.ops]
    orders = [(light, wanted), (prim, wanted if own else [schema.ORIENT]), (prim.GetParent(), [])]
    if any(_ops_of(one) != ops for one, ops in orders):
        return False
    for name in authored.ops:
        attribute = light.GetAttribute(name)
        if name in authored.constants:
            if attribute.GetTimeSamples() or attribute.Get() != authored.constants[name]:
                return False
            continue
        if name == schema.TRANSLATE:
            places, was = view.values(light, name, Gf.Vec3d(0)), authored.tracks[name].numpy()
            if bool((np.abs(places - was) > SIDE_MOVED * view.distance).any()):
                return False
            continue
        turns, was = view.values(light, name, Gf.Quatf(1)), authored.tracks[name].numpy()
        sign = np.where((turns * was).sum(-1, keepdims=True) < 0, -1.0, 1.0)
        if bool((np.abs(sign * turns - was) > SIDE_MOVED).any()):
            return False
    return True
