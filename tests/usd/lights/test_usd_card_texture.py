# SPDX-License-Identifier: Apache-2.0
"""Cards with the Gaussian texture, against closed forms, scipy's quadrature and the lobes."""

import math
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
import torch
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom, UsdLux
from scipy import integrate, stats
from usd_tracks import assert_same, edited, of_every_kind, still
from written_stages import calm, put_every

from asglight.lobes import Form, LobeTracks, asg
from asglight.usd import lint_stage, read_stage, read_usd, write_edit_layer, write_usd
from asglight.usd.lights import card_texture, cards
from asglight.usd.lights.cards import Kind
from asglight.usd.read.read_options import card_kinds, read_options
from asglight.usd.stage import find_rig

CUT = 3.0
"""Standard deviations to a side of a card, by the documents."""


def texels(path: Path) -> NDArray[np.float64]:
    with OpenEXR.File(str(path)) as file:
        return file.channels()["RGB"].pixels.astype(np.float64)


@pytest.fixture(scope="module")
def image(tmp_path_factory: pytest.TempPathFactory) -> NDArray[np.float64]:
    path = tmp_path_factory.mktemp("texture") / "card.exr"
    card_texture.write_texture(path)
    with OpenEXR.File(str(path)) as file:
        assert "envmap" not in file.header()  # it is no map of directions
    return texels(path)


def test_the_image_has_mean_one_and_looks_the_same_from_every_side(image):
    assert image.shape == (64, 64, 3)
    assert image.mean() == pytest.approx(1, abs=1e-4)  # half floats: 2e-4 each, which evens out
    for other in (image[::-1], image[:, ::-1], image.swapaxes(0, 1)):
        np.testing.assert_array_equal(other, image)
    assert (image == image[..., :1]).all()


def test_the_interpolated_image_has_the_width_of_the_gaussian(image):
    centres = (np.arange(64) + 0.5) / 32 - 1
    at = np.linspace(-1, 1, 20_001)
    profile = np.interp(at, centres, image[:, 31, 0])  # beyond the outer centres it stays
    wanted = stats.truncnorm(-CUT, CUT, scale=1 / CUT)
    variance = (profile * at**2).sum() / profile.sum()
    # half floats, and the outer half texels where interpolation ends
    assert variance == pytest.approx(wanted.var(), rel=1e-3)
    shape = profile / profile.sum() * len(at) / 2
    np.testing.assert_allclose(shape, wanted.pdf(at), atol=0.01 * wanted.pdf(0))


def test_a_narrow_card_has_the_closed_form_of_the_plane():
    p, q = 1e-3, 3e-4
    found = card_texture.measured(torch.tensor([p, q], dtype=torch.float64))
    # 1 / (1 + x^2 + y^2)^(5/2) is 1 to 3e-6 there
    assert float(found.solid_angle) == pytest.approx(4 * p * q, rel=1e-5)  # of mean 1
    variance = stats.truncnorm(-CUT, CUT, scale=1 / CUT).var()
    wanted = [p * p * variance, q * q * variance]
    np.testing.assert_allclose(found.mean_squares, wanted, rtol=1e-5)


def over_card(p: float, q: float, power_of_x: int) -> float:
    """Integrate x^k times the Gaussian of mean 1 over the directions of a card."""

    def integrand(y: float, x: float) -> float:
        gaussian = stats.norm.pdf(x / p * CUT) * stats.norm.pdf(y / q * CUT)
        return gaussian * x**power_of_x * (1 + x * x + y * y) ** (-(power_of_x + 3) / 2)

    inside = (2 * stats.norm.cdf(CUT) - 1) / (2 * CUT)  # mean of the density over a side
    return 4 * integrate.dblquad(integrand, 0, p, 0, q, epsabs=1e-12)[0] / inside**2


@pytest.mark.parametrize("extent", [(0.1, 0.02), (0.5, 1.5), (11.0, 0.3)])
def test_a_wide_card_is_the_integral_over_it(extent):
    found = card_texture.measured(torch.tensor(extent, dtype=torch.float64))
    exact = over_card(*extent, 0)
    # scipy's quadrature is good to 1e-7 of it here, the rule of asglight to 1e-6 at the widest
    assert float(found.solid_angle) == pytest.approx(exact, rel=2e-6)
    assert float(found.mean_squares[0]) == pytest.approx(over_card(*extent, 2) / exact, rel=2e-6)


@pytest.mark.parametrize("squares", [(1e-7, 3e-8), (0.02, 0.001), (0.2, 0.1), (0.33, 0.01)])
def test_sizes_give_the_mean_squares_asked_for_or_the_widest_card(squares):
    wanted = torch.tensor(squares, dtype=torch.float64)
    widest = math.tan(math.radians(85))
    extent = card_texture.half_extent(wanted, widest)
    assert float(extent.max()) <= widest
    found = card_texture.measured(extent).mean_squares
    free = extent < widest
    torch.testing.assert_close(found[free], wanted[free], rtol=1e-8, atol=0)
    assert bool(free.any())


def test_narrow_lobes_have_the_texture_and_broad_ones_have_not():
    assert cards.kinds(of_every_kind((1, 2, 3)).lobes, textured=True) == [
        Kind.FILL,
        Kind.SOFT,
        Kind.TEXTURED,
    ]


def textured(form: Form = Form.ASG) -> LobeTracks:
    """Return a lamp, a sun and a line, no wider of the flat form than of the asg."""
    shapes = [(60.0, 40.0), (8e3, 8e3), (900.0, 30.0)]
    if form is Form.FLAT:
        shapes = [(x * 85 / 66, y * 85 / 66) for x, y in shapes]
    if form is Form.SG:
        shapes = [(x, x) for x, _ in shapes]
    return still(shapes, form=form)


def put_cards(tracks: LobeTracks, path: Path, **options: bool) -> None:
    put_every(tracks, path, representations=("cards",), **options)


def light_of(path: Path, prim: Usd.Prim) -> tuple[NDArray, NDArray]:
    """Return what a card sends to the origin: directions, radiance times solid angle."""
    rect = UsdLux.RectLight(prim)
    asset = rect.GetTextureFileAttr().Get()
    assert asset.path == f"./{path.stem}_dome/{path.stem}.card.exr"
    image = texels(Path(asset.resolvedPath))[..., 0]
    # each texel in 4 x 4 pieces, as it is interpolated between the centres of texels
    at = (np.arange(256) + 0.5) / 256
    columns = np.stack([np.interp(at, (np.arange(64) + 0.5) / 64, row) for row in image])
    seen = np.stack([np.interp(at, (np.arange(64) + 0.5) / 64, c) for c in columns.T], axis=-1)
    half = [attr.Get() / 2 for attr in (rect.GetWidthAttr(), rect.GetHeightAttr())]
    y, x = np.meshgrid(*((1 - 2 * at) * half[1], (2 * at - 1) * half[0]), indexing="ij")
    points = np.stack([x, y, 0 * x, 1 + 0 * x], axis=-1).reshape(-1, 4)
    matrix = np.array(UsdGeom.XformCache().GetLocalToWorldTransform(prim))
    places = (points @ matrix)[:, :3]
    away = np.linalg.norm(places, axis=-1)
    directions = places / away[:, None]
    cosine = directions @ matrix[2, :3]
    area = 4 * half[0] * half[1] / len(points)
    intensity = UsdLux.LightAPI(prim).GetIntensityAttr().Get()
    return directions, intensity * seen.reshape(-1) * cosine * area / away**2


@pytest.mark.parametrize("form", Form)
def test_a_card_of_the_stage_has_the_flux_and_the_spread_of_its_lobe(form, tmp_path):
    path, tracks = tmp_path / "shot.usda", textured(form)
    put_cards(tracks, path, card_texture=True)
    stage = Usd.Stage.Open(str(path))
    lobes = tracks.lobes[0].to(torch.float64)
    zeroth, _, second = asg.moments(lobes)
    for index in range(3):
        found = [p for p in Usd.PrimRange(stage.GetPrimAtPath(f"/AsgRig/Lobes/lobe_0{index}"))]
        rects = [prim for prim in found if prim.GetTypeName() == "RectLight"]
        assert len(rects) == (2 if form is Form.BINGHAM else 1)
        directions, light = light_of(path, rects[0])
        flux = float(zeroth[index] * lobes.amplitude[index].max()) / len(rects)
        assert light.sum() == pytest.approx(flux, rel=1e-3)  # half floats; pieces of texels
        along = directions @ lobes.axes[index, :2].numpy().T
        spread = (along**2 * light[:, None]).sum(0) / light.sum()
        wanted = (second[index, :2] / zeroth[index]).numpy()
        np.testing.assert_allclose(np.sort(spread), np.sort(wanted), rtol=3e-3)


def test_a_card_shows_the_lobe_itself(tmp_path):
    """Texel for texel, on the scale of the peak; a uniform card is half of it in the middle."""
    path, tracks = tmp_path / "shot.usda", textured()
    put_cards(tracks, path, card_texture=True)
    stage = Usd.Stage.Open(str(path))
    # What ends at the sides makes the rest 2 % lower and wider; a lobe of 6 degrees is no longer
    # the Gaussian of a plane.
    for index, bound in ((0, 0.06), (1, 0.03)):
        directions, light = light_of(path, stage.GetPrimAtPath(f"/AsgRig/Lobes/lobe_0{index}"))
        lobe = tracks.lobes[0].to(torch.float64).select(torch.tensor([index]))
        wanted = asg.evaluate(lobe, torch.from_numpy(directions)).amax(-1).numpy()
        axis = directions @ lobe.axis_z[0].numpy()
        rect = UsdLux.RectLight(stage.GetPrimAtPath(f"/AsgRig/Lobes/lobe_0{index}"))
        area = rect.GetWidthAttr().Get() * rect.GetHeightAttr().Get() / len(light)
        radiance = light / (area * axis**3 / 1000**2)  # at 1,000 units, dw = dA cos^3 / 1000^2
        np.testing.assert_allclose(radiance, wanted, atol=bound * wanted.max())


@pytest.mark.parametrize(
    ("form", "suffix"), [*((form, "usda") for form in Form), (Form.ASG, "usdz")]
)
def test_a_stage_with_the_texture_comes_back(form, suffix, tmp_path):
    path, tracks = tmp_path / f"shot.{suffix}", of_every_kind((1001, 1002, 1003), form)
    report = write_usd(tracks, path, card_texture=True)
    assert lint_stage(path) == []
    reading = read_stage(path)
    assert reading.changes == ()
    assert_same(reading.tracks, tracks)
    assert read_options(path).card_texture
    stage = Usd.Stage.Open(str(path))
    assert card_kinds(find_rig(stage)) == [Kind.FILL, Kind.SOFT, Kind.TEXTURED]
    image = "shot_dome/shot.card.exr"
    if suffix == "usdz":
        assert image in zipfile.ZipFile(path).namelist()
    else:
        assert tmp_path / image in report.files


def test_without_a_narrow_lobe_or_the_option_there_is_no_texture(tmp_path):
    broad = of_every_kind((1, 2, 3)).lobes.select(torch.tensor([0, 1]))
    report = write_usd(LobeTracks((1, 2, 3), 24.0, broad), tmp_path / "a.usda", card_texture=True)
    report_plain = write_usd(textured(), tmp_path / "b.usda")
    assert not [file for file in (*report.files, *report_plain.files) if "card" in file.name]
    assert read_options(tmp_path / "a.usda").card_texture  # was asked for, and is so of a rewrite


def test_a_card_that_was_widened_is_a_broader_lobe(tmp_path):
    path = tmp_path / "shot.usda"
    put_cards(textured(), path, card_texture=True)
    card = "/AsgRig/Lobes/lobe_01"

    def widen(layer: Sdf.Layer) -> None:
        for name in ("width", "height"):
            layer.GetAttributeAtPath(f"{card}.inputs:{name}").default *= 2

    tracks = read_usd(edited(path, widen))
    # a narrow lobe: half the sharpness in each axis is twice its mean square
    np.testing.assert_allclose(tracks.lobes.sharpness[0, 1], [2e3, 2e3], rtol=5e-3)


def test_the_lint_finds_a_texture_of_another_mean(tmp_path):
    path = tmp_path / "shot.usda"
    put_every(textured(), path, dome_height=2, card_texture=True)
    target = tmp_path / "shot_dome" / "shot.card.exr"
    pixels = np.full((4, 4, 3), 1.5, dtype=np.float32)
    OpenEXR.File({"type": OpenEXR.scanlineimage}, {"RGB": pixels}).write(str(target))
    card = "/AsgRig{representation=cards}Lobes/lobe_00.inputs:texture:file"
    assert (
        f"{card}: is ./shot_dome/shot.card.exr of mean 1.5; expected 1, the flux of a card without "
        "it"
    ) in lint_stage(path)


def test_the_lint_finds_a_texture_that_changes(tmp_path):
    path = tmp_path / "shot.usda"
    put_every(textured(), path, dome_height=2, card_texture=True)
    card = "/AsgRig{representation=cards}Lobes/lobe_00.inputs:texture:file"
    image = Sdf.AssetPath("./shot_dome/shot.card.exr")
    change = edited(path, lambda layer: layer.SetTimeSample(card, 1001, image))
    assert lint_stage(change) == [f"{card}: changes over time; expected one image for all frames"]


def test_a_layer_of_edits_keeps_the_texture(tmp_path):
    """The edited lobe's card is as if the edit had been written, and has the stage's own image."""
    write_usd(calm(of_every_kind, (1, 2, 3)), tmp_path / "a.usda", card_texture=True)
    tracks = read_usd(tmp_path / "a.usda")
    lobes = tracks.lobes.clone()
    lobes.sharpness[:, 2] *= torch.tensor([0.5, 2.0])
    lobes.amplitude[:, 2] *= 3
    after = replace(tracks, lobes=lobes)
    write_edit_layer(tmp_path / "edit.usda", tmp_path / "a.usda", after, [2])
    write_usd(after, tmp_path / "direct.usda", card_texture=True)
    assert lint_stage(tmp_path / "edit.usda") == []
    reading = read_stage(tmp_path / "edit.usda")
    assert reading.changes == ()
    assert_same(reading.tracks, after)
    stages = [Usd.Stage.Open(str(tmp_path / name)) for name in ("edit.usda", "direct.usda")]
    found, wanted = (
        UsdLux.RectLight(stage.GetPrimAtPath("/AsgRig/Lobes/lobe_02")) for stage in stages
    )
    assert found.GetTextureFileAttr().Get().path == "./a_dome/a.card.exr"
    # an edit keeps what is width and what is height; written anew, the width is the longer one
    for name, other_name in (("width", "height"), ("height", "width"), ("intensity", "intensity")):
        own, other = (
            light.GetPrim().GetAttribute(f"inputs:{one}")
            for light, one in ((found, name), (wanted, other_name))
        )
        for frame in tracks.frames:
            assert own.Get(frame) == pytest.approx(other.Get(frame), rel=4e-4)  # samples left out
