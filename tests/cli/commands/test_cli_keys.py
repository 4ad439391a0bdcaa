# SPDX-License-Identifier: Apache-2.0
"""`asglight keys`, and the options of keys of `asglight fit`."""

import contextlib
import io
import json
import shutil
from collections.abc import Sequence
from pathlib import Path

import pytest
import torch
from key_cases import Rectangle, with_lamps
from pxr import Usd, UsdLux
from usd_tracks import contents

from asglight.cli.main import main
from asglight.images import read_latlong, write_exr
from asglight.shots import fit_shot
from asglight.shots.parts import farm
from asglight.shots.parts.chunks import Shot
from asglight.usd import lint_stage
from asglight.usd.read.keys import read_keys
from asglight.usd.read.read_options import read_options

ROWS = 64


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two frames with two lamps, and a stage fitted to them without keys."""
    folder = tmp_path_factory.mktemp("keys")
    for frame in (1, 2):
        lamps = (
            Rectangle(10 * frame, 20, 10, 14, 8),
            Rectangle(-100, 30, 0, 9, 7, (30.0, 30.0, 60.0)),
        )
        write_exr(folder / f"sky.{frame}.exr", with_lamps(ROWS, *lamps, rays=4))
    assert run("fit", folder / "sky.#.exr", "-o", folder / "sky.usda") == 0
    return folder


@pytest.fixture(scope="module")
def cut(folder: Path) -> tuple[Path, str]:
    """That stage with keys beside what it has, and what is said of it: to be read, or copied."""
    words = ["--reference", folder / "sky.#.exr", "-o", folder / "keyed.usda"]
    return folder / "keyed.usda", said("keys", folder / "sky.usda", *words)


@pytest.fixture(scope="module")
def fitted(folder: Path) -> tuple[Path, str]:
    """A stage that was fitted with keys, and what is said of it: to be read, or copied."""
    words = ["-o", folder / "fitted.usda", "--keys", "auto"]
    return folder / "fitted.usda", said("fit", folder / "sky.#.exr", *words)


def said(command: str, *words: str | Path) -> str:
    """Run a command that ends well, and return what it says."""
    with contextlib.redirect_stdout(io.StringIO()) as out:
        assert run(command, *words) == 0
    return out.getvalue()


def copied(stage: Path, folder: Path) -> Path:
    """Copy a stage and its images to where a test may change them."""
    images = f"{stage.stem}_dome"
    shutil.copytree(stage.with_name(images), folder / images)
    return Path(shutil.copy(stage, folder))


def run(command: str, *words: str | Path) -> int:
    """Run a command; a fit is of two lobes, for its keys are cut from the images."""
    few = ("--preset", "live", "--lobes", "2") if command == "fit" else ()
    return main([command, *map(str, words), *few])


def test_a_stage_gets_keys_beside_what_it_has(cut, capsys) -> None:
    target, text = cut
    assert "written as: keys, cards" in text
    assert "keys: 2, with " in text
    heads, *rows = text.split("keys: 2, with ")[1].splitlines()[1:4]
    named = "key light % of its lamp % degrees color stops above frames rim"
    assert " ".join(heads.split()) == named
    assert all(" 1-2 " in row for row in rows)
    assert all(len(line) <= 100 for line in [heads, *rows])
    assert read_options(target).representations == ("keys", "cards")
    assert run("info", target) == 0
    text = capsys.readouterr().out
    assert "representation: keys (also cards)" in text
    assert "keys: 2, with " in text


def test_what_was_repaired_in_the_images_is_said(folder, tmp_path, capsys) -> None:
    for frame in (1, 2):
        image = read_latlong(folder / f"sky.{frame}.exr").radiance.clone()
        image[0, 3] = -1e-3
        write_exr(tmp_path / f"sky.{frame}.exr", image, half=False)
    words = ["--reference", tmp_path / "sky.#.exr", "-o", tmp_path / "keyed.usda"]
    told = "repaired: 0 NaN and 2 negative texels set to 0 in 2 frames (1, 2)"
    assert said("keys", folder / "sky.usda", *words).splitlines()[-1] == told
    assert run("keys", folder / "sky.usda", *words, "--json") == 0
    assert json.loads(capsys.readouterr().out)["repairs"]["negative_texels"] == 2


def test_a_lamp_with_nothing_around_it_has_black_around_it_and_no_stops(tmp_path, capsys) -> None:
    alone = torch.zeros(32, 64, 3)
    alone[10:14, 20:26] = 5.0
    write_exr(tmp_path / "alone.exr", alone)
    assert run("fit", tmp_path / "alone.exr", "-o", tmp_path / "a.usda", "--keys", "auto") == 0
    text = capsys.readouterr().out
    assert "black around" in text


def test_info_tells_of_a_key_that_was_edited_and_of_no_other(cut, tmp_path, capsys) -> None:
    """A layer over the stage, as other programs write it."""
    target = copied(cut[0], tmp_path)
    assert run("info", target) == 0
    assert "edited:" not in capsys.readouterr().out
    stage = Usd.Stage.CreateNew(str(tmp_path / "edit.usda"))
    stage.GetRootLayer().subLayerPaths = ["./keyed.usda"]
    key = stage.GetPrimAtPath("/AsgRig/Keys").GetChildren()[0]
    light = key.GetAttribute("inputs:intensity")
    for time, value in [(time, light.Get(time)) for time in light.GetTimeSamples()]:
        light.Set(value / 2, time)
    light.Set(light.Get() / 2)
    stage.Save()
    assert run("info", tmp_path / "edit.usda") == 0
    edits = [one for one in capsys.readouterr().out.splitlines() if one.startswith("edited:")]
    assert edits == [f"edited: {key.GetPath()}: light x 0.5"]


def test_json_has_the_numbers_of_every_key(folder, tmp_path, capsys) -> None:
    words = ["--reference", folder / "sky.#.exr", "--keys", "1", "--keys-as", "distant", "--json"]
    target = tmp_path / "keyed.usda"
    assert run("keys", folder / "sky.usda", "-o", target, *words) == 0
    document = json.loads(capsys.readouterr().out)
    [key] = document["keys"]["keys"]
    assert key["share"] == pytest.approx(document["keys"]["share"])
    assert len(key["size_deg"]) == 2
    assert max(key["color"]) == pytest.approx(1, abs=1e-3)
    assert document["bytes"] > 0
    keys = read_keys(target)
    assert keys is not None
    assert keys.tracks is not None
    assert keys.tracks.lobes.count == 1


def test_a_fit_writes_keys_alone_or_beside_its_cards(folder, fitted, tmp_path, capsys) -> None:
    source = folder / "sky.#.exr"
    stage, text = fitted
    assert "keys: 2, with " in text
    assert read_options(stage).representations == ("keys", "cards")
    chosen = ["--representations", "keys", "--rest-height", "32", "--json"]
    assert run("fit", source, "-o", tmp_path / "b.usda", *chosen) == 0
    assert len(json.loads(capsys.readouterr().out)["keys"]["keys"]) == 2
    assert read_options(tmp_path / "b.usda").representations == ("keys",)
    assert (tmp_path / "b_dome" / "b.rest.0002.exr").is_file()


def names_of(stage: Path) -> tuple[str, ...]:
    keys = read_keys(stage)
    assert keys is not None
    assert keys.tracks is not None
    return keys.tracks.names


def test_names_of_keys_are_kept_over_fits_as_those_of_lobes(folder, fitted, tmp_path) -> None:
    stage = copied(fitted[0], tmp_path)
    first, second = names_of(stage)
    lobe = first.replace("key", "lobe")  # after which it is called
    stage.write_text(stage.read_text().replace(lobe, "lobe_07"))
    assert run("fit", folder / "sky.#.exr", "-o", stage, "--keys", "auto") == 0
    assert names_of(stage) == ("key_07", second)


def test_without_keys_a_stage_is_the_same_to_the_byte(folder, tmp_path) -> None:
    assert run("fit", folder / "sky.#.exr", "-o", tmp_path / "sky.usda", "--keys", "0") == 0
    wanted = {
        str(path.relative_to(folder)): path.read_bytes()
        for path in (folder / "sky.usda", *(folder / "sky_dome").iterdir())
    }
    assert contents(tmp_path) == wanted
    assert "sky_dome/sky.rest.0001.exr" not in wanted


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--keys", "some"], "'some'; expected auto or a number such as 3"),
        (["--keys", "-2"], "'-2'; expected auto or a number such as 3"),
        (["--keys-texture"], "--keys-texture: given without keys; expected --keys auto too."),
        (["--rest-height", "64"], "--rest-height: given without keys"),
        (["--keys", "auto", "--rest-height", "3"], "rest height: 3; expected 16 rows or more."),
        (
            ["--keys", "0", "--representations", "keys"],
            "keys: 0, and the representation keys is asked for",
        ),
        (
            ["--keys", "auto", "--keys-texture", "--keys-as", "distant"],
            "keys texture: given with distant lights, which have none; expected --keys-as rect.",
        ),
        (
            ["--keys", "auto", "--rest-height", "3", "--scheduler", "local"],
            "rest height: 3; expected 16 rows or more.",
        ),
    ],
)
def test_what_cannot_be_meant_is_one_line(folder, tmp_path, capsys, words, message) -> None:
    status = run("fit", folder / "sky.#.exr", "-o", tmp_path / "a.usda", *words)
    assert status == 2
    error = capsys.readouterr().err
    assert message in error
    assert not (tmp_path / "a.usda").exists()


def test_a_reference_that_lacks_a_frame_and_no_keys_at_all_are_one_line(folder, tmp_path, capsys):
    stage = folder / "sky.usda"
    assert run("keys", stage, "--reference", folder / "sky.1.exr", "-o", tmp_path / "a.usda") == 2
    error = capsys.readouterr().err
    assert "lacks 2 of" in error
    assert error.endswith("Keys are cut in every frame of the stage.\n")
    words = ["--reference", folder / "sky.#.exr"]
    assert run("keys", stage, *words, "--keys", "0") == 2
    assert "keys: 0; expected auto or a number above 0." in capsys.readouterr().err
    assert main(["keys", "--help"]) == 0
    assert "or so many at most (default: auto)" in " ".join(capsys.readouterr().out.split())
    assert run("keys", stage, *words, "--representations", "cards,foo") == 2
    told = "argument --representations: cards,foo; expected some of cards, distant, dome, keys,"
    assert told in capsys.readouterr().err
    assert run("keys", stage, *words, "--frames", "1") == 2
    assert "unrecognized arguments: --frames 1." in capsys.readouterr().err


def test_a_damaged_image_is_told_and_no_other_one_is_kept_in_its_place(
    folder, tmp_path, capsys
) -> None:
    for frame in (1, 2):
        shutil.copy(folder / f"sky.{frame}.exr", tmp_path)
    cut_short = tmp_path / "sky.2.exr"
    cut_short.write_bytes(cut_short.read_bytes()[: cut_short.stat().st_size // 2])
    words = ["--reference", tmp_path / "sky.#.exr", "-o", tmp_path / "a.usda"]
    assert run("keys", folder / "sky.usda", *words) == 2
    assert "sky.2.exr: cannot be decoded" in capsys.readouterr().err
    assert not (tmp_path / "a.usda").exists()


def same_keys(first: Path, second: Path) -> None:
    """Hold keys, their names and their rest against those of another stage."""
    found, wanted = read_keys(first), read_keys(second)
    assert found is not None
    assert wanted is not None
    assert found.tracks is not None
    assert wanted.tracks is not None
    assert found.tracks.names == wanted.tracks.names
    torch.testing.assert_close(
        found.tracks.lobes.amplitude, wanted.tracks.lobes.amplitude, rtol=1e-4, atol=1e-6
    )
    torch.testing.assert_close(found.tracks.lobes.axes, wanted.tracks.lobes.axes, rtol=0, atol=1e-5)
    for place in range(len(wanted.times)):
        assert torch.equal(found.rest.radiance(place), wanted.rest.radiance(place))


@pytest.mark.parametrize("texture", [[], ["--keys-texture"]])
def test_more_representations_leave_keys_and_their_images_as_they_are(
    folder, tmp_path, capsys, texture
) -> None:
    keyed, more = tmp_path / "keyed.usda", tmp_path / "more.usda"
    words = ["--reference", folder / "sky.#.exr", "-o", keyed, "--representations", "keys"]
    assert run("keys", folder / "sky.usda", *words, *texture) == 0
    assert run("export", keyed, "--to", "cards", "-o", more) == 0
    assert "more.usda: keys, cards" in capsys.readouterr().out
    same_keys(more, keyed)
    before, after = (
        sorted(path.name.split(".", 1)[1] for path in stage.glob("*.exr"))
        for stage in (tmp_path / "keyed_dome", tmp_path / "more_dome")
    )
    assert set(after) - {name for name in after if name.startswith("fill")} == set(before)
    assert run("export", more, "--to", "dome") == 0  # over the stage itself
    same_keys(more, keyed)
    assert lint_stage(more) == []


def test_a_rest_that_was_dimmed_elsewhere_is_not_copied_as_it_was(cut, tmp_path, capsys) -> None:
    keyed = copied(cut[0], tmp_path)
    stage = Usd.Stage.Open(str(keyed))
    UsdLux.LightAPI(stage.GetPrimAtPath("/AsgRig/Rest")).GetExposureAttr().Set(-1.0)
    stage.Save()
    assert run("info", keyed) == 0
    assert "edited: /AsgRig/Rest: light x 0.5" in capsys.readouterr().out
    assert run("export", keyed, "--to", "dome") == 2
    assert "the rest was changed (/AsgRig/Rest: light x 0.5)" in capsys.readouterr().err


def test_an_image_of_the_rest_that_is_gone_is_told_as_such(cut, tmp_path, capsys) -> None:
    keyed = copied(cut[0], tmp_path)
    (tmp_path / "keyed_dome" / "keyed.rest.0002.exr").unlink()
    assert run("export", keyed, "--to", "dome", "-o", tmp_path / "more.usda") == 2
    assert "the image of the rest at frame 2 is not there" in capsys.readouterr().err
    assert not (tmp_path / "more.usda").exists()


@pytest.fixture(scope="module")
def textured(folder: Path) -> Path:
    """A stage whose keys have the pixels of their lamps: to be copied."""
    words = ["--reference", folder / "sky.#.exr", "-o", folder / "textured.usda", "--keys-texture"]
    said("keys", folder / "sky.usda", *words, "--representations", "keys")
    return folder / "textured.usda"


def test_pixels_of_a_key_that_were_replaced_are_told(textured, tmp_path, capsys) -> None:
    keyed = copied(textured, tmp_path)
    pixels = next((tmp_path / "textured_dome").glob("textured.key_*.exr"))
    write_exr(pixels, torch.full((8, 16, 3), 7.0))
    assert run("export", keyed, "--to", "dome", "-o", tmp_path / "more.usda") == 2
    said_of_it = capsys.readouterr().err
    assert f"the texture of {pixels.name.split('.')[1]} is ./textured_dome/" in said_of_it
    assert "of mean 7; expected 1" in said_of_it


def test_pixels_outside_the_folder_of_a_stage_are_not_copied(textured, tmp_path) -> None:
    (tmp_path / "in").mkdir()
    keyed = copied(textured, tmp_path / "in")
    secret = tmp_path / "secret.exr"
    write_exr(secret, torch.ones(8, 16, 3))
    stage = Usd.Stage.Open(str(keyed))
    for key in stage.GetPrimAtPath("/AsgRig/Keys").GetChildren():
        attribute = key.GetAttribute("inputs:texture:file")
        attribute.Clear()
        attribute.Set(str(secret))
    stage.Save()
    more = tmp_path / "in" / "more.usda"
    assert run("export", keyed, "--to", "dome", "-o", more) == 0
    copies = [data for data in contents(tmp_path / "in").values() if data == secret.read_bytes()]
    assert copies == []
    assert lint_stage(more) == []


def fitted_here(shots: Sequence[Shot], *_: object, **__: object) -> list[str]:
    """Fit shots as a farm does, in this process."""
    for shot in shots:
        settings = {"frames": shot.frames, "fps": shot.fps, "stage": shot.stage}
        fit_shot(shot.source, shot.output, shot.options, missing=shot.missing, **settings)
    return [shot.output for shot in shots]


def test_a_farm_leaves_stages_whose_keys_are_cut_here(
    folder, fitted, tmp_path, monkeypatch
) -> None:
    monkeypatch.setattr(farm, "fit_on_farm", fitted_here)
    target = tmp_path / "farm.usda"
    words = [folder / "sky.#.exr", "--keys", "auto", "-o", target]
    assert run("fit", *words, "--scheduler", "local:1") == 0
    assert read_options(target).representations == ("keys", "cards")
    found, wanted = read_keys(target), read_keys(fitted[0])
    assert found is not None
    assert wanted is not None
    for place in range(2):
        assert torch.equal(found.rest.radiance(place), wanted.rest.radiance(place))


def test_keys_of_a_farm_fill_the_frames_that_its_fits_fill(folder, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(farm, "fit_on_farm", fitted_here)
    for source, frame in ((1, 1), (2, 2), (2, 4)):
        shutil.copy(folder / f"sky.{source}.exr", tmp_path / f"sky.{frame}.exr")
    (tmp_path / "sky.2.exr").write_bytes(b"damaged")
    target = tmp_path / "farm.usda"
    words = [tmp_path / "sky.#.exr", "--keys", "auto", "--missing", "hold", "-o", target]
    assert run("fit", *words, "--scheduler", "local:1", "--frames", "1-5") == 0
    found = read_keys(target)
    assert found is not None
    assert found.times == (1, 2, 3, 4, 5)
    first, *held, fourth, last = [found.rest.radiance(place) for place in range(5)]
    assert all(torch.equal(one, first) for one in held)
    assert torch.equal(last, fourth)
    assert not torch.equal(fourth, first)
