# SPDX-License-Identifier: Apache-2.0
"""How far linear interpolation strays from cards and discs of lobes in motion (span_errors.py).

Symbols: S spans, Q probes, K even steps, C cards.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import torch
from torch import Tensor

from asglight.usd.lights import cards, distant
from asglight.usd.lights.emission import intensity_and_color
from asglight.usd.write.span_errors import (
    MARGIN,
    TURN_DEG,
    Curve,
    Flux,
    at_ends,
    at_probes,
    lerp,
    times_between,
    total,
    worst,
)

ROUNDING = 1e-15
"""Of a ratio near 1. It decides the size of cards of 0.000003 degrees."""


@dataclass(frozen=True)
class CardSpans:
    """Spans of cards that have one radiance, such as `tall` and `wide`.

    Attributes:
        flux: Theirs together.
        squares: Logarithms of their mean x^2 and y^2.  S of [C, 2]
        sizes: Logarithms of what gives their sizes from these, the `cards.ratio_of` less 1; for
            cards with the texture, those of their sizes.  S of [C, .]
        is_textured: Whether they have the texture.
    """

    flux: Flux
    squares: Curve
    sizes: Curve
    is_textured: bool = False

    @classmethod
    def of(
        cls, flux: Flux, squares: Tensor, pieces: Sequence[cards.Piece], *, is_textured: bool
    ) -> Self:
        """Take the mean squares of lobes at even steps.  [S, K, 2]."""
        relative = squares.new_tensor([piece.squares for piece in pieces])
        own = squares[:, :, None] * relative  # [S, K, C, 2]
        extents = cards.extent(own, is_textured=is_textured)
        if is_textured:
            sizes = extents
        else:
            sizes = (cards.ratio_of(extents)[..., None] - 1).clamp(min=ROUNDING)
        return cls(flux, Curve.through(own.log()), Curve.through(sizes.log()), is_textured)

    def at(self, index: Tensor) -> Self:
        """Pick spans."""
        return replace(
            self,
            flux=self.flux.at(index),
            squares=self.squares.at(index),
            sizes=self.sizes.at(index),
        )

    def error(self, before: Tensor, after: Tensor) -> Tensor:
        """Return the largest error of any card."""
        times = times_between(before, after)
        whole, sizes = self.flux.when(times), self._sizes(times)  # [S, 1 + Q + 1, C, 2]
        solids = cards.solid_angle(sizes)
        lights = whole / solids.sum(-1)[..., None]
        (dim, dim_tint), (lit, lit_tint) = map(intensity_and_color, at_ends(lights))
        shown = lerp(dim, lit)[..., None] * lerp(dim_tint, lit_tint)
        size, now = lerp(*at_ends(sizes)), at_probes(sizes)
        solid, true_solid = cards.solid_angle(size), at_probes(solids)
        shown, light = shown[:, :, None], at_probes(lights)[:, :, None]
        flux, true = shown * solid[..., None], light * true_solid[..., None]
        common = cards.solid_angle(torch.minimum(size, now))
        radiance = _apart(shown, flux, light, true, common)  # of a Gaussian it is less
        all_light = total(at_probes(whole))
        over = self.flux.scale(at_probes(times), all_light) / all_light
        scale = total(true) * over[..., None]
        return worst(*(one.flatten(1) for one in (total(flux - true), radiance, scale)))

    def _sizes(self, time: Tensor) -> Tensor:
        """Return half width and half height of the cards at distance 1.  [S, Q, C, 2]."""
        sizes = self.sizes.when(time).exp()
        if self.is_textured:
            return sizes
        return cards.extent_of(self.squares.when(time).exp(), 1 + sizes)


@dataclass(frozen=True)
class DiscSpans:
    """Spans of a lobe's distant lights: one disc, or three in a row.

    Attributes:
        flux: The lobe's.
        facing: Logarithm of the irradiance on a patch that faces it, over the flux.  S
        squares: Logarithms of its mean x^2 and y^2.  S of 2
        is_three: Whether they are three.
    """

    flux: Flux
    facing: Curve
    squares: Curve
    is_three: bool

    @classmethod
    def of(cls, flux: Flux, facing: Tensor, squares: Tensor, *, is_three: bool) -> Self:
        """Take what is known at even steps: facing irradiance [S, K], mean squares [S, K, 2]."""
        return cls(flux, Curve.through(facing.log()), Curve.through(squares.log()), is_three)

    def at(self, index: Tensor) -> Self:
        """Pick spans."""
        return replace(
            self,
            flux=self.flux.at(index),
            facing=self.facing.at(index),
            squares=self.squares.at(index),
        )

    def error(self, before: Tensor, after: Tensor) -> Tensor:
        """Return the largest error of any disc."""
        times = times_between(before, after)
        whole, (radii, tilts) = self.flux.when(times), self._discs(times)
        lights = self._lights(times, whole, tilts)
        radius, tilted = lerp(*at_ends(radii)), lerp(*at_ends(tilts))
        (dim, dim_tint), (lit, lit_tint) = map(intensity_and_color, at_ends(lights))
        irradiance = lerp(dim, lit)[..., None] * lerp(dim_tint, lit_tint)
        true_radius, tilt, wanted = map(at_probes, (radii, tilts, lights))
        shown = irradiance / (torch.pi * radius.sin().square())[..., None]
        light = wanted / (torch.pi * true_radius.sin().square())[..., None]
        solid, true_solid = _cap(radius), _cap(true_radius)
        flux, true = shown * solid[..., None], light * true_solid[..., None]
        radiance = _apart(shown, flux, light, true, torch.minimum(solid, true_solid))
        all_light = total(at_probes(whole))
        scale = total(true) * (self.flux.scale(at_probes(times), all_light) / all_light)
        moved = (tilted - tilt).norm(dim=-1)
        # of two discs side by side, 4 d / (pi r) of the area lies outside the other, d apart
        aside = 2 * distant.OUTER * 4 * moved / (torch.pi * true_radius)
        radiance = radiance + aside * total(true)
        turned = torch.rad2deg(moved).amax(-1) / (MARGIN * TURN_DEG)
        return torch.maximum(worst(total(flux - true), radiance, scale), turned)

    def _lights(self, time: Tensor, whole: Tensor, tilt: Tensor) -> Tensor:
        """Return the irradiance of the discs, up to a constant.  [S, Q, 3]."""
        share = (1 - 2 * distant.OUTER) + 2 * distant.OUTER * tilt.norm(dim=-1).cos()
        return whole * (self.facing.when(time).exp() / share)[..., None]

    def _discs(self, time: Tensor) -> tuple[Tensor, Tensor]:
        """Return the radius of the discs [S, Q], and the way to the outer ones [S, Q, 2]."""
        squares = self.squares.when(time).exp()
        if not self.is_three:
            return distant.disc_radius(squares.sum(-1)), torch.zeros_like(squares)
        spread = distant.Spread.of(squares)
        along_x = spread.along_x[..., None] == torch.tensor([True, False])
        return spread.radius, torch.where(along_x, spread.tilt[..., None], 0.0)


def _apart(shown: Tensor, flux: Tensor, light: Tensor, wanted: Tensor, common: Tensor) -> Tensor:
    """Return the integral of the difference of two even lights about one centre.

    Args:
        shown: Radiance of the one.  [S, Q, 3]
        flux: Its flux.  [S, Q, 3]
        light: Radiance of the other.  [S, Q, 3]
        wanted: Its flux.  [S, Q, 3]
        common: Solid angle that both shine from.  [S, Q]
    """
    both = common[..., None]
    beyond = (flux - shown * both) + (wanted - light * both)
    return total((shown - light).abs() * both + beyond.clamp(min=0))


def _cap(radius: Tensor) -> Tensor:
    """Return the solid angle of discs."""
    return 4 * torch.pi * (radius / 2).sin().square()
