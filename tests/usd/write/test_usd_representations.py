# SPDX-License-Identifier: Apache-2.0
"""Stages of any subset of the representations: plain prims for one, variants for several."""

import itertools
from dataclasses import replace
from pathlib import Path

import pytest
from pxr import Sdf, Usd, UsdGeom, UsdValidation
from usd_tracks import assert_same, moving, of_every_kind, write_every
from written_stages import calm, selected

from asglight import InputError
from asglight.lobes import Form, LobeTracks
from asglight.usd import (
    add_representations,
    lint_stage,
    read_stage,
    read_usd,
    write_edit_layer,
    write_usd,
)
from asglight.usd.options import OF_LOBES, parse_representations
from asglight.usd.read.read_options import read_options

FRAMES = (1001, 1002, 1003)
SUBSETS = [
    names
    for count in (1, 2, 3)
    for names in itertools.combinations([str(one) for one in OF_LOBES], count)
] + [("distant", "cards"), ("dome", "distant", "cards")]
"""All of them, and each representation as the first of several."""


def written(folder: Path, names: tuple[str, ...], form: Form = Form.ASG, **options) -> Path:
    path = folder / "shot.usda"
    write_usd(
        calm(of_every_kind, FRAMES, form), path, representations=names, dome_height=8, **options
    )
    return path


@pytest.fixture(scope="module")
def subset(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[tuple[str, ...], Path]:
    """Return names and the stage of just these, for tests that only look at it."""
    return request.param, written(tmp_path_factory.mktemp("subset"), request.param)


def edited(path: Path, lobe: int) -> tuple[LobeTracks, LobeTracks]:
    """Return the tracks of a stage, and the same with a lobe that is brighter and turned."""
    before = read_usd(path)
    lobes = before.lobes.clone()
    lobes.amplitude[:, lobe] *= 2
    lobes.axes[:, lobe] = lobes.axes[:, lobe, [1, 2, 0]]
    return before, replace(before, lobes=lobes)


def values(stage: Usd.Stage) -> dict[str, list[object]]:
    """Return every attribute of every prim that is composed, over the frames."""
    return {
        str(attribute.GetPath()): [attribute.Get(frame) for frame in FRAMES]
        for prim in stage.Traverse()
        for attribute in prim.GetAuthoredAttributes()
    }


@pytest.mark.parametrize("subset", SUBSETS, ids="-".join, indirect=True)
def test_any_subset_validates_reads_back_and_says_what_it_is(subset):
    names, path = subset
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    assert lint_stage(path) == []
    stage = Usd.Stage.Open(str(path))
    assert UsdValidation.ValidationContext(validators).Validate(stage) == []
    reading = read_stage(path)
    assert reading.changes == ()
    assert_same(reading.tracks, calm(of_every_kind, FRAMES))
    held = read_options(path).representations
    assert held[0] == names[0]
    assert set(held) == set(names)
    images = {image.name.split(".")[1] for image in (path.parent / "shot_dome").glob("*.exr")}
    # the fill is written with the cards, the dome's images with the dome
    assert ("fill" in images) is ("cards" in names)
    assert ("1001" in images) is ("dome" in names)


@pytest.mark.parametrize("form", [Form.ASG, Form.BINGHAM])
def test_one_alone_composes_to_what_its_variant_does(form, tmp_path):
    every = tmp_path / "all" / "shot.usda"
    every.parent.mkdir()
    write_every(calm(of_every_kind, FRAMES, form), every, dome_height=8, distant_lights=3)
    for representation in OF_LOBES:
        (tmp_path / representation).mkdir()
        alone = written(tmp_path / representation, (representation,), form, distant_lights=3)
        stage, other = Usd.Stage.Open(str(alone)), selected(every, representation)
        found, wanted = values(stage), values(other)
        assert found.keys() == wanted.keys()
        for name, value in found.items():
            assert str(value) == str(wanted[name]).replace("/all/", f"/{representation}/"), name
        assert [prim.GetTypeName() for prim in stage.Traverse()] == [
            prim.GetTypeName() for prim in other.Traverse()
        ]


@pytest.mark.parametrize("representation", OF_LOBES)
def test_one_alone_is_plain_prims(representation, tmp_path):
    """No variants, no overrides; a prim that orders transforms says all of them itself."""
    layer = Sdf.Layer.FindOrOpen(str(written(tmp_path, (representation,), distant_lights=3)))
    specs: list[Sdf.PrimSpec] = []

    def look(path: Sdf.Path) -> None:
        assert not path.ContainsPrimVariantSelection()
        if path.IsPrimPath():
            specs.append(layer.GetPrimAtPath(path))

    layer.Traverse(Sdf.Path.absoluteRootPath, look)
    for spec in specs:
        assert spec.specifier == Sdf.SpecifierDef
        assert spec.typeName
        order = spec.attributes.get("xformOpOrder")
        for name in [] if order is None else order.default:
            assert name in spec.attributes


@pytest.mark.parametrize("subset", SUBSETS, ids=",".join, indirect=True)
def test_ops_are_declared_where_they_are_ordered(subset):
    layer = Sdf.Layer.FindOrOpen(str(subset[1]))
    ordered = []

    def look(path: Sdf.Path) -> None:
        if path.name == "xformOpOrder":
            ordered.append(path)

    layer.Traverse("/", look)
    assert ordered
    for path in ordered:
        prim = layer.GetPrimAtPath(path.GetPrimOrPrimVariantSelectionPath())
        ops = layer.GetAttributeAtPath(path).default
        assert set(ops) <= set(prim.attributes.keys()), path


def test_the_order_of_names_decides_the_selection_only(tmp_path):
    for stem, names in (("a", ("cards", "dome")), ("b", ("dome", "cards"))):
        (tmp_path / stem).mkdir()
        written(tmp_path / stem, names)
    one, other = ((tmp_path / stem / "shot.usda").read_text() for stem in "ab")
    assert one.replace('representation = "cards"', 'representation = "dome"') == other


@pytest.mark.parametrize(
    ("names", "lobes"),
    # cards are of three kinds, distant lights and domes of one
    [(("cards",), (0, 1, 2)), (("distant",), (0,)), (("dome",), (1,)), (("distant", "dome"), (2,))],
)
def test_a_layer_of_edits_lies_over_any_subset(names, lobes, tmp_path):
    path = written(tmp_path, names)
    for lobe in lobes:
        before, after = edited(path, lobe)
        layer = tmp_path / f"edit{lobe}.usda"
        write_edit_layer(layer, path, after, [lobe])
        assert_same(read_usd(layer), after)
        assert read_stage(layer).changes == ()
        assert lint_stage(layer) == []
        assert read_options(layer).representations == names
        assert_same(read_usd(path), before)
        images = [file.name for file in (tmp_path / f"edit{lobe}_dome").glob("*.exr")]
        assert any(".100" in name and "fill" not in name for name in images) is ("dome" in names)


@pytest.mark.parametrize(("names", "factor"), [(("cards",), 3.0), (("distant",), 3.0)])
def test_a_light_that_another_program_edits_counts(names, factor, tmp_path):
    path = tmp_path / "shot.usda"
    write_usd(calm(moving, FRAMES), path, representations=names)
    before = read_usd(path)
    stage = Usd.Stage.Open(str(path))
    lobe = stage.GetPrimAtPath("/AsgRig/Lobes/lobe_01")
    for light in Usd.PrimRange(lobe):
        if light.GetTypeName().endswith("Light"):
            attribute = light.CreateAttribute("inputs:exposure", Sdf.ValueTypeNames.Float)
            attribute.Set(1.5849625)  # log2 of 3
    stage.GetRootLayer().Save()
    reading = read_stage(path)
    assert reading.changes == ("/AsgRig/Lobes/lobe_01: light x 3",)
    ratio = reading.tracks.lobes.amplitude / before.lobes.amplitude
    assert ratio[:, 1].flatten().tolist() == pytest.approx([factor] * 9, rel=1e-5)


def test_a_dome_alone_that_is_turned_turns_its_lobes(tmp_path):
    path = written(tmp_path, ("dome",))
    stage = Usd.Stage.Open(str(path))
    UsdGeom.Xformable(stage.GetPrimAtPath("/AsgRig/Dome")).AddRotateYOp().Set(90.0)
    stage.GetRootLayer().Save()
    assert read_stage(path).changes == ("/AsgRig/Dome: turned by 90 degrees",)


# ---- more of them later ----


@pytest.mark.parametrize("suffix", ["usda", "usdc", "usdz"])
def test_a_dome_is_added_later(suffix, tmp_path):
    path = tmp_path / f"shot.{suffix}"
    tracks = calm(of_every_kind, FRAMES)
    write_usd(tracks, path, dome_height=8, card_texture=True, up_axis="Z")
    report = add_representations(path, ["dome"])
    assert report.files[0] == path
    assert read_options(path).representations == ("cards", "dome")
    assert lint_stage(path) == []
    assert_same(read_usd(path), tracks)
    assert read_usd(path).names == tracks.names


def test_the_same_one_added_changes_nothing(tmp_path):
    path = tmp_path / "shot.usda"
    write_usd(calm(moving, FRAMES), path, representations=("distant",))
    before = read_usd(path)
    add_representations(path, ["distant"])
    assert read_options(path).representations == ("distant",)
    assert_same(read_usd(path), before)


def test_what_another_program_added_is_not_written_over(tmp_path):
    path = tmp_path / "shot.usda"
    write_usd(calm(moving, FRAMES), path)
    stage = Usd.Stage.Open(str(path))
    stage.DefinePrim("/AsgRig/Ground", "Mesh")
    stage.GetRootLayer().Save()
    before = path.read_bytes()
    with pytest.raises(InputError, match=r"holds /AsgRig/Ground, which asglight did not write; "):
        add_representations(path, ["dome"])
    assert path.read_bytes() == before
    add_representations(path, ["dome"], tmp_path / "other.usda")
    assert read_options(tmp_path / "other.usda").representations == ("cards", "dome")


def test_a_layer_of_edits_is_not_written_over(tmp_path):
    path = written(tmp_path, ("cards",))
    _, after = edited(path, 0)
    write_edit_layer(tmp_path / "edit.usda", path, after, [0])
    with pytest.raises(InputError, match=r"edit.usda: holds \./shot.usda, which asglight did not"):
        add_representations(tmp_path / "edit.usda", ["dome"])
    add_representations(tmp_path / "edit.usda", ["distant"], tmp_path / "flat.usda")
    assert_same(read_usd(tmp_path / "flat.usda"), after)


# ---- names ----


def test_a_list_of_representations_is_parsed():
    assert parse_representations("dome, cards") == ("dome", "cards")


@pytest.mark.parametrize("text", ["", "cards,", "lamps", "dome,dome"])
def test_a_list_that_is_none_is_refused(text):
    with pytest.raises(InputError, match=r"^representations: .*; expected some of cards, distant"):
        parse_representations(text)
