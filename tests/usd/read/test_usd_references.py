# SPDX-License-Identifier: Apache-2.0
"""A stage from outside makes asglight open nothing but what lies in its own folder."""

import math
import os
import shutil
import signal
from pathlib import Path
from typing import Any

import pytest
from pxr import Gf, Sdf, Usd, UsdGeom
from usd_tracks import moving

from asglight.cli.main import main
from asglight.errors import InputError
from asglight.usd import lint_stage, read_usd, schema, write_usd
from asglight.usd.check import references, trust
from asglight.usd.options import DOME_HEIGHT
from asglight.usd.read.read_options import read_options
from asglight.usd.stage import open_stage


@pytest.fixture(autouse=True)
def unasked(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trust, "_ASKED", trust._Asked())


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a text, a binary and a packaged stage, elsewhere."""
    folder = tmp_path_factory.mktemp("library")
    for suffix in ("usda", "usdc", "usdz"):
        write_usd(moving([1, 2]), folder / f"shot.{suffix}", representations=("distant",))
    return folder


def reference(layer: Sdf.Layer, target: str) -> None:
    spec = Sdf.CreatePrimInLayer(layer, "/Set")
    spec.referenceList.prependedItems = [Sdf.Reference(target, "/AsgRig")]


def in_variant(layer: Sdf.Layer, target: str) -> None:
    spec = Sdf.CreatePrimInLayer(layer, "/Set{look=hidden}")
    spec.payloadList.prependedItems = [Sdf.Payload(target, "/AsgRig")]


def clips(layer: Sdf.Layer, target: str) -> None:
    spec = Sdf.CreatePrimInLayer(layer, "/Set")
    spec.SetInfo("clips", {"default": {"assetPaths": Sdf.AssetPathArray([Sdf.AssetPath(target)])}})


def sublayer(layer: Sdf.Layer, target: str) -> None:
    layer.subLayerPaths = [target]


WAYS = {"sublayer": sublayer, "reference": reference, "payload in a variant": in_variant}


def layer_with(path: Path, way: object, target: str) -> Path:
    layer = Sdf.Layer.CreateAnonymous()
    way(layer, target)
    layer.Export(str(path))
    return path


@pytest.mark.parametrize("suffix", ["usda", "usdc"])
@pytest.mark.parametrize("way", WAYS)
def test_a_layer_outside_the_folder_is_not_opened(
    tmp_path: Path, library: Path, way: str, suffix: str
) -> None:
    target = str(tmp_path / "library.usda")  # nobody has opened this one
    shutil.copy(library / "shot.usda", target)
    (tmp_path / "shot").mkdir()
    path = layer_with(tmp_path / "shot" / f"a.{suffix}", WAYS[way], target)
    with pytest.raises(InputError) as caught:
        open_stage(path)
    assert str(caught.value) == (
        f"{path}: refers to {target}, outside its folder; expected layers beside or below it. If "
        "you know where it comes from, add --follow-references."
    )
    assert Sdf.Layer.Find(target) is None
    trust.follow_references()
    stage = open_stage(path)  # kept: its layers die with it
    used = {layer.realPath for layer in stage.GetUsedLayers()}
    assert (target in used) is (way != "payload in a variant")  # which is not chosen


@pytest.mark.parametrize("suffix", ["usda", "usdc"])
def test_value_clips_are_not_followed(tmp_path: Path, library: Path, suffix: str) -> None:
    path = layer_with(tmp_path / f"a.{suffix}", clips, str(library / "shot.usda"))
    with pytest.raises(InputError, match=r"a\.usd.: has value clips at /Set; expected layers"):
        open_stage(path)
    trust.follow_references()
    open_stage(path)


def test_a_link_out_of_the_folder_is_no_way_round(tmp_path: Path, library: Path) -> None:
    (tmp_path / "inner.usda").symlink_to(library / "shot.usda")
    path = layer_with(tmp_path / "a.usda", sublayer, "./inner.usda")
    with pytest.raises(InputError, match=r"refers to \./inner\.usda, outside its folder"):
        open_stage(path)


def test_a_layer_of_a_layer_is_looked_at_too(tmp_path: Path, library: Path) -> None:
    layer_with(tmp_path / "b.usdc", sublayer, str(library / "shot.usda"))
    path = layer_with(tmp_path / "a.usda", sublayer, "./b.usdc")
    with pytest.raises(InputError, match="outside its folder"):
        open_stage(path)


def test_layers_in_the_folder_are_followed(tmp_path: Path, library: Path) -> None:
    (tmp_path / "below").mkdir()
    shutil.copy(library / "shot.usdc", tmp_path / "below")
    path = layer_with(tmp_path / "a.usda", reference, "./below/shot.usdc")
    assert len(open_stage(path).GetPrimAtPath("/Set/Lobes").GetChildren()) == 3


def test_layers_that_refer_to_each_other_end(tmp_path: Path) -> None:
    layer_with(tmp_path / "b.usda", sublayer, "./a.usda")
    path = layer_with(tmp_path / "a.usda", sublayer, "./b.usda")
    with pytest.raises(InputError):
        read_usd(path)


@pytest.mark.parametrize("followed", [False, True])
def test_a_pipe_is_never_opened(tmp_path: Path, followed: bool) -> None:
    os.mkfifo(tmp_path / "pipe.usda")  # opening it would wait for ever
    path = layer_with(tmp_path / "a.usda", sublayer, "./pipe.usda")
    if followed:
        trust.follow_references()
    with pytest.raises(InputError, match=r"refers to \./pipe\.usda, which is no file; expected"):
        open_stage(path)


@pytest.mark.parametrize("suffix", ["usda", "usdc", "usdz"])
def test_a_stage_by_itself_is_read(library: Path, suffix: str) -> None:
    path = library / f"shot.{suffix}"
    assert read_usd(path).lobes.count == 3
    assert lint_stage(path) == []


def test_a_binary_stage_that_ends_its_reader_is_one_line(
    library: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    read_usd(library / "shot.usdc")
    path = library / "copy.usdc"
    shutil.copy(library / "shot.usdc", path)
    process = references._PROBE._process
    assert process is not None
    os.kill(process._process.pid, signal.SIGABRT)
    with pytest.raises(InputError) as caught:
        read_usd(path)
    assert str(caught.value) == (
        f"{path}: not readable as USD (its reader was stopped by SIGABRT); expected a USD stage. "
        "Is the file whole?"
    )
    assert read_usd(path).lobes.count == 3
    assert capfd.readouterr() == ("", "")


def test_a_binary_stage_is_tried_out_once_until_it_changes(
    library: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = library / "tried.usdc"
    shutil.copy(library / "shot.usdc", path)
    tried: list[str] = []
    tell = references.Apart.tell

    def counting(process: references.Apart, request: dict[str, Any]) -> None:
        tried.append(request["layer"])
        tell(process, request)

    monkeypatch.setattr(references.Apart, "tell", counting)
    read_usd(path)
    read_usd(path)
    assert tried == [str(path)]
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(InputError, match="not readable as USD"):
        read_usd(path)
    assert tried == [str(path)] * 2


def test_the_option_follows(
    tmp_path: Path, library: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = str(layer_with(tmp_path / "a.usda", reference, str(library / "shot.usda")))
    for command in (
        ["info", path],
        ["export", path, "--to", "json", "-o", str(tmp_path / "a.json")],
    ):
        trust._ASKED.follows_outside = False
        assert main(command) == 2
        assert "outside its folder" in capfd.readouterr().err
        assert main([*command, "--follow-references"]) == 0
        assert "2 frames (1-2)" in capfd.readouterr().out


def test_an_image_outside_the_folder_is_not_opened(tmp_path: Path) -> None:
    path = tmp_path / "shot" / "shot.usda"
    path.parent.mkdir()
    write_usd(moving([1, 2]), path, representations=("dome",), dome_height=4)
    outside = tmp_path / "images"
    shutil.copytree(path.parent / "shot_dome", outside)
    path.write_text(path.read_text().replace("./shot_dome", "../images"))
    assert read_options(path).dome_height == DOME_HEIGHT  # the usual one, as where none is there
    trust.follow_references()
    assert read_options(path).dome_height == 4


def edited_stage(path: Path, library: Path, light_edit: object) -> Path:
    shutil.copy(library / "shot.usda", path)
    stage = Usd.Stage.Open(str(path))
    light_edit(stage.GetPrimAtPath("/AsgRig"), stage.GetPrimAtPath("/AsgRig/Lobes/lobe_00"))
    stage.Save()
    return path


def test_a_light_that_is_not_finite_is_refused(tmp_path: Path, library: Path) -> None:
    def edit(rig: Usd.Prim, lobe: Usd.Prim) -> None:
        lobe.GetAttribute("inputs:intensity").Set(math.inf, 1)
        lobe.GetAttribute("inputs:intensity").Set(math.inf, 2)

    path = edited_stage(tmp_path / "a.usda", library, edit)
    with pytest.raises(InputError, match=r"the light of lobe_00 is not finite at frame 1; exp"):
        read_usd(path)


def test_a_light_whose_size_is_not_finite_is_refused(tmp_path: Path, library: Path) -> None:
    def edit(rig: Usd.Prim, lobe: Usd.Prim) -> None:
        lobe.GetAttribute(schema.ANGLE).Set(math.inf)
        lobe.GetAttribute(schema.ANGLE).Set(math.inf, 1)

    path = edited_stage(tmp_path / "a.usda", library, edit)
    with pytest.raises(InputError, match=r"lobe_00\S* has a size that is not finite"):
        read_usd(path)


def test_a_light_that_is_turned_by_no_rotation_is_refused(tmp_path: Path, library: Path) -> None:
    def edit(rig: Usd.Prim, lobe: Usd.Prim) -> None:
        UsdGeom.Xformable(lobe).AddTransformOp(opSuffix="odd").Set(Gf.Matrix4d(math.nan))

    path = edited_stage(tmp_path / "a.usda", library, edit)
    with pytest.raises(InputError, match=r"lobe_00\S* is turned by no rotation at frame 1"):
        read_usd(path)


@pytest.mark.parametrize("distance", ["far", -3.0, math.inf])
def test_a_distance_of_cards_that_is_none_counts_as_the_usual(
    tmp_path: Path, library: Path, distance: object
) -> None:
    def edit(rig: Usd.Prim, lobe: Usd.Prim) -> None:
        rig.SetCustomDataByKey(f"{schema.CUSTOM_DATA}:{schema.DISTANCE}", distance)

    path = edited_stage(tmp_path / "a.usda", library, edit)
    assert read_options(path).distance == 1000.0
    assert read_usd(path).lobes.count == 3


def test_text_that_is_not_utf_8_is_one_line(tmp_path: Path, library: Path) -> None:
    data = (library / "shot.usda").read_bytes()
    path = tmp_path / "a.usda"
    path.write_bytes(data.replace(b"(1, 2)", b"(1, \xff)").replace(b"AsgRig", b"Asg\xffig"))
    with pytest.raises(InputError, match=r"a\.usda: ") as caught:
        read_usd(path)
    assert str(caught.value).isprintable()
