# SPDX-License-Identifier: Apache-2.0
"""A lobe as cards: rectangles of constant radiance with the lobe's flux and second moments.

A sharp lobe is one card. A softer one is three about the same centre, whose sum has its shape. A
lobe too broad for them shines from the fill, a small dome that all broad lobes share. Where cards
have a texture, a lobe that is not too broad is one card with it (card_texture.py). Which
of these holds for the whole shot, so no lobe pops.

A card lies in the plane z = 1 of the lobe's frame, |x| <= p, |y| <= q, and is seen from the origin;
at another distance it scales. With s = p q / sqrt(1 + p^2 + q^2), integrating over the plane with
dw = dx dy / (1 + x^2 + y^2)^(3/2) gives the closed forms

    solid angle       W = 4 atan s
    mean of x^2       (1 - s / ((1 + p^2) atan s)) / 3, and likewise y^2 with q.

So the mean squares asked for give 1 + p^2 and 1 + q^2 from s alone, and s is a fixed point.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import torch
from pxr import Gf, Sdf
from torch import Tensor

from asglight.lobes import asg, frames, motion
from asglight.lobes.data import Form, Lobes
from asglight.lobes.rectangles import Rectangles, rectangles
from asglight.usd import schema
from asglight.usd.lights import card_texture
from asglight.usd.lights.emission import intensity_and_color, tinted
from asglight.usd.lights.light import Light, on_sides


class Kind(StrEnum):
    """What a lobe's light is in the representation `cards`, in all frames of a stage."""

    SINGLE = "single"
    """One card, which is the lobe's own prim; one a side for the bingham form."""
    SOFT = "soft"
    """Three cards, below the lobe's prim."""
    TEXTURED = "textured"
    """One card with the texture, in the place that a single one has."""
    FILL = "fill"
    """No card: a share of the fill's images."""


@dataclass(frozen=True)
class Piece:
    """One card of a lobe.

    Attributes:
        name: Of its prim below the lobe's; empty for the lobe's own.
        squares: Its mean x^2 and y^2 relative to the lobe's.
        distance: Relative to the cards' distance. Renderers that take lights as surfaces lose one
            of two that coincide.
    """

    name: str
    squares: tuple[float, float]
    distance: float = 1.0


_SHORT, _LONG, _OUTER_SHARE = 0.2494, 0.9412, 0.2949
"""Least squares between three centred rectangles and a plane Gaussian, alike in x and y, of its
variance, both blurred by half its width: 3.5 % off, and 23 % with one rectangle."""

_OUTER = (1 - (1 - _OUTER_SHARE) * (_SHORT + _LONG) / 2) / _OUTER_SHARE  # so that the means agree

LEVELS: dict[Kind, tuple[tuple[float, tuple[Piece, ...]], ...]] = {
    Kind.SINGLE: ((1.0, (Piece("", (1.0, 1.0)),)),),
    Kind.SOFT: (
        (
            1 - _OUTER_SHARE,
            (Piece("tall", (_SHORT, _LONG)), Piece("wide", (_LONG, _SHORT), 1.001)),
        ),
        (_OUTER_SHARE, (Piece("outer", (_OUTER, _OUTER), 1.002),)),
    ),
    Kind.TEXTURED: ((1.0, (Piece("", (1.0, 1.0)),)),),
    Kind.FILL: (),
}
"""Shares of a lobe's flux, and the cards of one radiance that carry each."""

SINGLE_SQUARE = 1e-3
"""Mean x^2 and y^2 up to which one card does: a width of 1.8 degrees, 1 % on a ball of roughness
0.25."""

TEXTURED_SQUARE = 0.02
"""Mean x^2 and y^2 up to which one card with the texture is better than three without: a width of 8
degrees. Broader lobes are less of a Gaussian on a plane: three cards are 2 % off on a ball of
roughness 0.25 either way at this width, and at 20 degrees 10 %, but 15 % with the texture."""

FILL_HEIGHT = 64
"""Rows of the fill's images, of 2.8 degrees: 0.3 % off on a ball of roughness 0.25, 4 % with half
as many."""

HALF_ANGLE_MAX_DEG = 85.0
"""Widest card; one of 90 degrees would be infinite. Lobes that spread farther are fill, however
narrow they are the other way: a band around the horizon of 1.6 degrees, a twelfth of the light, is
1.5 % off on a ball of roughness 0.25 in the fill's texels, and 4.5 % on cards that end at 85."""

WIDEST = math.tan(math.radians(HALF_ANGLE_MAX_DEG))
"""Its half width at distance 1."""

_SQUARE_MAX = (1 - 1 / (1 + WIDEST**2)) / 3
"""Mean x^2 of a card that is the widest both ways."""

FIXED_POINT_STEPS = 30
"""At most, each of two iterations and a limit; five are enough for any card."""

_CONVERGED = 1e-9
"""Relative, of s in the last step: the digits double with each, so what is left is 1e-11."""

_ROUNDING = 1e-15
"""Relative, of s: a sequence that bends by less has come to its limit."""


def solid_angle(half_extent: Tensor) -> Tensor:
    """Return the solid angle of cards in the plane z = 1, in steradians.

    Args:
        half_extent: (p, q), the tangents of the half-angles.  [..., 2]
    """
    return 4 * torch.atan(_corner(half_extent))


def half_extent(mean_squares: Tensor) -> Tensor:
    """Return (p, q) of the cards with these mean x^2 and y^2, no wider than the widest card.

    The mean over a card stays below 1/3; more gets the widest card.

    Args:
        mean_squares: Of unit directions, float64.  [..., 2]

    Returns:
        Half width and half height at distance 1.  [..., 2]
    """
    corner = torch.zeros_like(mean_squares[..., 0])
    for _ in range(FIXED_POINT_STEPS):
        first = _corner(extent_of(mean_squares, _ratio(corner)))
        second = _corner(extent_of(mean_squares, _ratio(first)))
        # Aitken's limit of three terms of a sequence whose errors shrink by a factor
        bend = second - 2 * first + corner
        moves = bend.abs() > _ROUNDING * second
        limit = corner - (first - corner).square() / torch.where(moves, bend, 1.0)
        following = torch.where(moves, limit, second).clamp(min=0)
        done = bool(((following - corner).abs() <= _CONVERGED * following).all())
        corner = following
        if done:
            break
    return extent_of(mean_squares, _ratio(corner))


def extent_of(mean_squares: Tensor, ratio: Tensor) -> Tensor:
    """Return (p, q) of cards, no wider than the widest.

    Args:
        mean_squares: Of unit directions, float64.  [..., 2]
        ratio: s / atan s of the cards, as of `ratio_of`.  [..., 1]
    """
    rest = (1 - 3 * mean_squares).clamp(min=1 / (1 + WIDEST**2))  # at and below it it is widest
    return (ratio / rest - 1).clamp(min=0).sqrt().clamp(max=WIDEST)


def ratio_of(half_extent: Tensor) -> Tensor:
    """Return s / atan s of cards, which changes little with their size.  [..., 2] -> [...]."""
    return _ratio(_corner(half_extent))[..., 0]


def _ratio(corner: Tensor) -> Tensor:
    """Return s / atan s, which tends to 1; the clamp avoids 0 / 0 and is exact to 1e-24."""
    corner = corner.clamp(min=1e-12)
    return (corner / torch.atan(corner))[..., None]


def extent(mean_squares: Tensor, *, is_textured: bool) -> Tensor:
    """Return half width and half height at distance 1 of cards with or without the texture.

    Args:
        mean_squares: Mean x^2 and y^2 of their light, float64.  [..., 2]
        is_textured: Whether they have it.
    """
    if is_textured:
        return card_texture.half_extent(mean_squares, WIDEST)
    return half_extent(mean_squares)


def mean_squares(moments: asg.Moments) -> Tensor:
    """Return each lobe's mean x^2 and y^2, in its frame.  [..., N, 2]."""
    return moments.second[..., :2] / moments.zeroth[..., None]


def kinds(lobes: Lobes, *, textured: bool = False) -> list[Kind]:
    """Choose what each lobe is in all frames, by its mean over them, weighted by flux.

    Args:
        lobes: Lobes of F frames.  [F, N, .]
        textured: Whether cards have a texture where that is better.

    Returns:
        One for each lobe.
    """
    lobes = lobes.to("cpu", torch.float64)
    moments = motion.resting_moments(lobes)
    weight = lobes.amplitude.sum(-1) * moments.zeroth
    dark = weight.sum(0) == 0
    weight = torch.where(dark, 1.0, weight) / torch.where(dark, len(weight), weight.sum(0))
    square = (weight * mean_squares(moments).amax(-1)).sum(0)
    single = square <= (TEXTURED_SQUARE if textured else SINGLE_SQUARE)
    one_card = Kind.TEXTURED if textured else Kind.SINGLE
    fill = square * _OUTER > _SQUARE_MAX  # the outer card would be wider than the widest
    return [
        Kind.FILL if is_fill else one_card if is_single else Kind.SOFT
        for is_fill, is_single in zip(fill.tolist(), single.tolist(), strict=True)
    ]


def values(
    lobes: Lobes, moments: asg.Moments, distance: float, kind: Kind
) -> dict[Piece, dict[str, Tensor]]:
    """Return the RectLight attributes of each lobe's cards, on each side for the bingham form.

    Args:
        lobes: N lobes of a kind, with any batch shape.  [..., N, .]
        moments: Theirs, float64.  [..., N, .]
        distance: From the origin to the cards, in stage units.
        kind: Which kind.

    Returns:
        For each card width, height, intensity [..., N, 1] and colour [..., N, 3], float64.
    """
    flux = lobes.amplitude.to(torch.float64) * moments.zeroth[..., None]
    sides = 2 if lobes.form is Form.BINGHAM else 1
    is_textured = kind is Kind.TEXTURED
    levels = LEVELS[kind]
    relative = flux.new_tensor([piece.squares for _, pieces in levels for piece in pieces])
    wanted = mean_squares(moments)[..., None, :] * relative.reshape(-1, 2)  # [..., N, C, 2]
    extents = extent(wanted, is_textured=is_textured)
    angles = card_texture.measured(extents).solid_angle if is_textured else solid_angle(extents)
    counts = [len(pieces) for _, pieces in levels]
    of_levels = zip(levels, extents.split(counts, -2), angles.split(counts, -1), strict=True)
    found = {}
    for (share, pieces), own, angle in of_levels:
        intensity, color = intensity_and_color(share / sides * flux / angle.sum(-1, keepdim=True))
        for piece, one in zip(pieces, own.unbind(-2), strict=True):
            size = 2 * piece.distance * distance * one
            found[piece] = {
                schema.WIDTH: size[..., :1],
                schema.HEIGHT: size[..., 1:],
                schema.INTENSITY: intensity[..., None],
                schema.COLOR: color,
            }
    return found


def rectangles_of(lobes: Lobes, moments: asg.Moments | None = None) -> Rectangles:
    """Return the one card of each lobe, where it stands: with its slant where it has one.

    Args:
        lobes: N lobes, float64, with any batch shape.  [..., N, .]
        moments: Theirs, where they are known.  [..., N, .]
    """
    own = half_extent(mean_squares(moments or asg.moments(lobes)))
    return rectangles(lobes.axes, own, lobes.slant)


def _slanted(lobes: Lobes, moments: asg.Moments, distance: float) -> Light | None:
    """Return the one card of a lobe that is slanted in a frame, None where it never is.

    Args:
        lobes: One lobe in F frames.  [F, 1, .]
        moments: Theirs, float64.  [F, 1, .]
        distance: From the origin to the card, in stage units.
    """
    if lobes.slant is None or not bool((lobes.slant != 0).any()):
        return None
    lobes = lobes.to(torch.float64)
    at_rest = replace(lobes, axes=torch.eye(3, dtype=torch.float64).expand(lobes.axes.shape))
    found = rectangles_of(at_rest, moments)  # in the lobe's own frame
    flux = lobes.amplitude * moments.zeroth[..., None]
    intensity, color = intensity_and_color(flux / found.solid_angle()[..., None])
    sizes = 2 * distance * found.half
    turns = frames.continuous_quaternions(frames.quaternion_from_axes(found.axes))
    tracks = {
        schema.WIDTH: sizes[..., :1],
        schema.HEIGHT: sizes[..., 1:],
        schema.INTENSITY: intensity[..., None],
        schema.COLOR: tinted(intensity, color),
        schema.TRANSLATE: distance * found.middle,
        schema.ORIENT_SLANT: turns,
    }
    ops = (schema.TRANSLATE, schema.ORIENT_SLANT)
    own = {name: values[:, 0] for name, values in tracks.items()}
    return Light("", own, {schema.NORMALIZE: False}, ops)


def lights(
    lobes: Lobes,
    moments: asg.Moments,
    distance: float,
    chosen: Sequence[Kind],
    texture: str = "",
) -> list[list[Light]]:
    """Return the cards of every lobe.

    Args:
        lobes: Lobes of F frames.  [F, N, .]
        moments: Theirs, float64.  [F, N, .]
        distance: From the origin to the cards, in stage units.
        chosen: What each lobe is.
        texture: That of the cards, relative to the stage; empty where there is none.
    """
    found: list[list[Light]] = [[] for _ in chosen]
    for member, own in enumerate(found):
        index = torch.tensor([member])
        slanted = _slanted(lobes.select(index), moments.select(index), distance)
        own += [slanted] if slanted else []
    for kind in Kind:
        members = [k for k, one in enumerate(chosen) if one is kind and not found[k]]
        if not members:
            continue
        index = torch.tensor(members, dtype=torch.long)
        own = values(lobes.select(index), moments.select(index), distance, kind)
        for piece, tracks in own.items():
            color = tinted(tracks[schema.INTENSITY][..., 0], tracks[schema.COLOR])
            tracks = {**tracks, schema.COLOR: color}
            constants = {
                schema.TRANSLATE: Gf.Vec3d(0, 0, piece.distance * distance),
                schema.NORMALIZE: False,
            }
            if kind is Kind.TEXTURED and texture:
                constants[schema.TEXTURE] = Sdf.AssetPath(texture)
            for place, member in enumerate(members):
                one = {name: value[:, place] for name, value in tracks.items()}
                found[member].append(Light(piece.name, one, constants, (schema.TRANSLATE,)))
    return [on_sides(own, lobes.form) for own in found]


def _corner(half_extent: Tensor) -> Tensor:
    """Return s = p q / sqrt(1 + p^2 + q^2), the tangent of a quarter of the solid angle."""
    p, q = half_extent.unbind(-1)
    return p * q / (1 + (p * p + q * q)).sqrt()
