# SPDX-License-Identifier: Apache-2.0
"""Which part of the map its panel shows."""

from dataclasses import dataclass

ZOOM_MAX = 32.0
"""A texel of a map of 512 columns is then as wide as a thumb."""


@dataclass
class MapFrame:
    """A part of the map, as high and wide in it as in the panel.

    Attributes:
        zoom: How many times the map is larger than the panel, 1 or more.
        left: Share of the map's columns left of the panel.
        top: Share of its rows above it.
    """

    zoom: float = 1.0
    left: float = 0.0
    top: float = 0.0

    def zoom_at(self, x: float, y: float, factor: float) -> None:
        """Zoom about a place of the panel, in shares of it from its top left corner."""
        u, v = self.left + x / self.zoom, self.top + y / self.zoom
        self.zoom = max(1.0, min(ZOOM_MAX, self.zoom * factor))
        self._move_to(u - x / self.zoom, v - y / self.zoom)

    def pan(self, right: float, down: float) -> None:
        """Move the map by shares of the panel."""
        self._move_to(self.left - right / self.zoom, self.top - down / self.zoom)

    def show_all(self) -> None:
        """Show all of the map."""
        self.zoom, self.left, self.top = 1.0, 0.0, 0.0

    def area(self, columns: float, rows: float) -> tuple[float, float, float, float]:
        """Return where all of the map lies for a panel of a size: x, y, columns and rows."""
        wide, high = columns * self.zoom, rows * self.zoom
        return -self.left * wide, -self.top * high, wide, high

    def _move_to(self, left: float, top: float) -> None:
        most = 1 - 1 / self.zoom
        self.left, self.top = max(0.0, min(most, left)), max(0.0, min(most, top))
