# SPDX-License-Identifier: Apache-2.0
"""What leads a newcomer to a first change: formulas are where they are said, examples work."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
import torch
from pxr import Usd, UsdGeom, UsdLux

import asglight
from asglight.judging.compare import methods
from asglight.judging.metrics import map_errors
from asglight.lobes import Lobes, LobeTracks
from asglight.lobes.frames import axes_around

ROOT = Path(__file__).resolve().parents[2]
PAGES = ROOT / "docs" / "contributing"


def example(page: str) -> dict:
    """Run the Python of a page and return its names."""
    names: dict = {}
    for block in re.findall(r"```python\n(.*?)```", (PAGES / page).read_text(), re.DOTALL):
        exec(block, names)
    return names


def test_ten_formulas_are_where_the_page_says() -> None:
    text = (PAGES / "README.md").read_text()
    rows = re.findall(r"^\| .+ \| `(def \w+)` \| `(asglight/[\w/]+\.py)` \|$", text, re.MULTILINE)
    assert len(rows) == 10
    for words, file in rows:
        assert f"{words}(" in (ROOT / file).read_text(), (words, file)


def test_files_and_names_that_the_pages_mention_are_there() -> None:
    new = {"asglight/peers/even.py", "asglight/viewer/panels/totals.py"} | {
        "asglight/usd/lights/sphere.py"
    }
    for page in PAGES.glob("*.md"):
        for path in re.findall(r"`((?:asglight|tests|dcc)/[\w/]+(?:\.py|/))`", page.read_text()):
            assert path in new or (ROOT / path).exists(), (page.name, path)


def test_the_peer_of_the_page_is_judged_as_any_other(monkeypatch: pytest.MonkeyPatch) -> None:
    names = example("peer.md")
    method = methods.Method("Even light", lambda task: names["even"](task.reference, task.floats))
    monkeypatch.setitem(methods.METHODS, "even", method)
    even = torch.full((8, 16, 3), 0.5)
    again = names["even"](even, 120)
    assert again.floats <= 120
    torch.testing.assert_close(again.texel_means(8, 16), even)
    lamp = even.clone()
    lamp[2, 3] = 40.0
    found = map_errors(names["even"](lamp, 120).texel_means(8, 16), lamp).values
    assert found["flux"] == pytest.approx(0, abs=1e-6)
    assert found["env"] > 0.1


def test_the_metric_of_the_page_is_an_angle_of_colours() -> None:
    hue_error = example("metric.md")["hue_error"]
    red, green = torch.zeros(2, 8, 16, 3).unbind(0)
    red[..., 0], green[..., 1] = 2.0, 0.5
    assert hue_error(3 * red, red) == pytest.approx(0, abs=1e-5)
    assert hue_error(green, red) == pytest.approx(90)
    half = torch.where(torch.arange(8)[:, None, None] < 4, red, green)
    assert hue_error(half, red) == pytest.approx(45)


def test_the_representation_of_the_page_has_the_irradiance_that_usd_defines() -> None:
    axis = torch.tensor([[0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])
    sharpness = torch.tensor([[40.0, 40.0], [3.0, 3.0]])
    amplitude = torch.tensor([[2.0, 1.0, 0.5], [0.0, 0.25, 0.25]])
    lobes = Lobes(axes_around(axis), sharpness, amplitude)
    tracks = LobeTracks((1,), 24.0, Lobes(lobes.axes[None], sharpness[None], amplitude[None]))
    stage = Usd.Stage.CreateInMemory()
    example("representation.md")["sphere_lights"](stage, tracks, "/Rig")
    for index, name in enumerate(tracks.names):
        light = UsdLux.SphereLight(stage.GetPrimAtPath(f"/Rig/{name}"))
        place = UsdGeom.Xformable(light).GetLocalTransformation().ExtractTranslation()
        distance = math.hypot(*place)
        np.testing.assert_allclose(np.array(place) / distance, axis[index], atol=1e-6)
        # UsdLux: radiance is intensity times colour; the sphere fills sin^2 = (r / d)^2
        radiance = light.GetIntensityAttr().Get() * np.array(light.GetColorAttr().Get())
        shown = math.pi * radiance * (light.GetRadiusAttr().Get() / distance) ** 2
        # brute force of the lobe's irradiance on the patch that faces it
        grid = asglight.latlong(Lobes(*(one[index : index + 1] for one in _parts(lobes))), 256)
        np.testing.assert_allclose(shown, _facing(grid, axis[index]), rtol=2e-3)


def _parts(lobes: Lobes) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    return lobes.axes, lobes.sharpness, lobes.amplitude


def _facing(radiance: torch.Tensor, normal: torch.Tensor) -> np.ndarray:
    """Sum radiance times the clamped cosine over texels, by numpy alone."""
    height, width, _ = radiance.shape
    latitude = np.pi / 2 - np.pi * (np.arange(height) + 0.5) / height
    longitude = np.pi - 2 * np.pi * (np.arange(width) + 0.5) / width
    y = np.broadcast_to(np.sin(latitude)[:, None], (height, width))
    x = np.cos(latitude)[:, None] * np.sin(longitude)
    z = np.cos(latitude)[:, None] * np.cos(longitude)
    edges = np.sin(np.pi / 2 - np.pi * np.arange(height + 1) / height)
    area = 2 * np.pi / width * (edges[:-1] - edges[1:])
    cosine = np.maximum(np.stack([x, y, z], -1) @ normal.numpy(), 0)
    return np.einsum("h,hw,hwc->c", area, cosine, radiance.double().numpy())
