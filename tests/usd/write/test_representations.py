# SPDX-License-Identifier: Apache-2.0
"""`benchmarks/stages/representations.py`: its lights against closed forms, and its tables."""

import math

import pytest
import torch
from bench_scripts import module
from pxr import Gf, Usd, UsdGeom, UsdLux
from usd_tracks import moving, still, write_every
from written_stages import calm

from asglight.images import write_exr
from asglight.lobes import Form, asg
from asglight.sphere import latlong
from asglight.usd.lights import card_texture

lights = module("stages.representations_lights")
representations = module("stages.representations")


def irradiance(arriving, normal: tuple[float, float, float]) -> float:
    cosine = arriving.directions @ torch.tensor(normal, dtype=torch.float64)
    return float((cosine.clamp(min=0) * arriving.light[:, 0]).sum())


def rect(width: float, height: float) -> tuple[Usd.Stage, UsdLux.RectLight]:
    """Return a card one unit along +Z that shines at the origin."""
    stage = Usd.Stage.CreateInMemory()
    light = UsdLux.RectLight.Define(stage, "/card")
    light.AddTranslateOp().Set(Gf.Vec3d(0, 0, 1))
    light.CreateWidthAttr(width)
    light.CreateHeightAttr(height)
    light.CreateIntensityAttr(2.0)
    return stage, light


def test_a_card_has_the_irradiance_of_the_closed_form():
    """Configuration factor of a rectangle to a point below its middle, four times a quarter's."""
    stage, _ = rect(3.0, 0.8)
    a, b = 1.5, 0.4
    quarter = (
        a / math.hypot(1, a) * math.atan(b / math.hypot(1, a))
        + b / math.hypot(1, b) * math.atan(a / math.hypot(1, b))
    ) / 2
    arriving, count = lights.of_stage(stage, 0.0)
    assert count == 1
    assert irradiance(arriving, (0, 0, 1)) == pytest.approx(2 * 4 * quarter, rel=1e-7)  # float32


def test_a_texture_of_mean_one_keeps_the_flux_of_a_narrow_card(tmp_path):
    stage, light = rect(0.02, 0.01)
    plain, _ = lights.of_stage(stage, 0.0)
    card_texture.write_texture(tmp_path / "card.exr")
    light.CreateTextureFileAttr(str(tmp_path / "card.exr"))
    textured, _ = lights.of_stage(stage, 0.0)
    # half floats, and the rule over the slopes of the interpolated image
    assert float(textured.light.sum()) == pytest.approx(float(plain.light.sum()), rel=1e-3)
    spread = [
        float((part.directions[:, 0] ** 2 * part.light[:, 0]).sum() / part.light[:, 0].sum())
        for part in (plain, textured)
    ]
    assert spread[1] / spread[0] == pytest.approx(3 * 0.9733 / 9, rel=2e-3)  # cut at 3 deviations
    left_out, _ = lights.of_stage(stage, 0.0, card_texture=False)
    torch.testing.assert_close(left_out.light, plain.light)


@pytest.mark.parametrize("angle", [1.0, 60.0, 170.0])
def test_a_distant_light_has_its_intensity_as_irradiance(angle):
    stage = Usd.Stage.CreateInMemory()
    light = UsdLux.DistantLight.Define(stage, "/sun")
    light.CreateAngleAttr(angle)
    light.CreateIntensityAttr(3.0)
    UsdLux.LightAPI(light).CreateNormalizeAttr(True)
    UsdGeom.Xformable(light).AddRotateYOp().Set(90.0)  # towards +X
    arriving, _ = lights.of_stage(stage, 0.0)
    assert irradiance(arriving, (1, 0, 0)) == pytest.approx(3.0, rel=1e-6)


def test_a_dome_shines_from_where_its_texels_are(tmp_path):
    radiance = torch.zeros(8, 16, 3)
    radiance[2, 4] = 5.0
    write_exr(tmp_path / "dome.exr", radiance)
    stage = Usd.Stage.CreateInMemory()
    UsdLux.DomeLight.Define(stage, "/dome").CreateTextureFileAttr(str(tmp_path / "dome.exr"))
    arriving, _ = lights.of_stage(stage, 0.0)
    mean = (arriving.directions * arriving.light[:, :1]).sum(0)
    towards = latlong.directions(8, 16, dtype=torch.float64)[2, 4]
    # bilinear hats lean towards the equator, where rows have more area: some degrees of 22
    assert float(torch.nn.functional.normalize(mean, dim=0) @ towards) > math.cos(math.radians(4))


@pytest.mark.parametrize("form", Form)
def test_lobes_have_the_flux_of_their_closed_form(form):
    lobes = still([(5.0, 5.0), (300.0, 300.0)], form=form).lobes[0].to(torch.float64)
    # beyond five deviations lie 6e-7 of a lobe; the narrow sg is cut there
    flux = lights.of_lobes(lobes).light.sum(0)
    torch.testing.assert_close(flux, asg.flux(lobes).sum(0), rtol=1e-5, atol=0)


def first_table(text: str) -> dict[str, dict[str, list[float]]]:
    """Return rows of the table of RMSE by name: for each way the error on each ball, in percent."""
    lines = text[text.index("RMSE") : text.index("Absolute")].strip().splitlines()
    header, _, *rows = ([cell.strip() for cell in line.split("|")[1:-1]] for line in lines[2:])
    return {
        row[0]: {
            way: [float(value) for value in cell.split("/")]
            for way, cell in zip(header[1:], row[1:], strict=True)
        }
        for row in rows
    }


@pytest.fixture
def few_points(monkeypatch):
    """Five points a ball in place of a hundred: the errors are means over fewer."""
    monkeypatch.setattr(representations, "POINTS", 5)


@pytest.mark.usefixtures("few_points")
def test_a_map_is_fitted_and_measured_in_every_way(tmp_path, capsys):
    write_exr(tmp_path / "lamp.exr", lamp())
    representations.main(["--maps", str(tmp_path)])
    table = first_table(capsys.readouterr().out)
    assert list(table) == ["lamp", "**mean**", "**worst**"]
    row = table["lamp"]
    assert list(row) == [
        "cards",
        "cards, texture",
        "texture left out",
        "distant",
        "distant x 3",
        "dome",
    ]
    assert table["**mean**"] == row
    assert max(row["dome"]) < 1  # of 256 rows: a texel is a tenth of the narrowest reflection
    assert max(row["cards"][0], row["cards, texture"][0]) < 1


@pytest.mark.usefixtures("few_points")
def test_a_stage_is_measured_in_its_first_middle_and_last_frame(tmp_path, capsys):
    stage = tmp_path / "shot.usda"
    write_every(calm(moving, range(1, 6)), stage, dome_height=16)
    representations.main(["--stages", str(stage)])
    table = first_table(capsys.readouterr().out)
    assert list(table) == ["shot 1", "shot 3", "shot 5", "**mean**", "**worst**"]
    assert list(table["shot 1"]) == ["cards", "distant", "dome"]
    columns = zip(*(table[name]["distant"] for name in list(table)[:3]), strict=True)
    # printed to a tenth
    assert table["**worst**"]["distant"] == [max(column) for column in columns]


def test_nothing_to_measure_is_said(capsys):
    with pytest.raises(SystemExit):
        representations.main([])
    assert "one of the arguments --maps --stages is required" in capsys.readouterr().err


def lamp() -> torch.Tensor:
    """Return a grey sky with a lamp of some degrees.  [32, 64, 3]."""
    directions = latlong.directions(32, 64)
    axis = torch.nn.functional.normalize(torch.tensor([0.4, 0.6, 0.7]), dim=0)
    return 0.1 + 20 * torch.exp(60 * (directions @ axis - 1))[..., None].expand(-1, -1, 3)
