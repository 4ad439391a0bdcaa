# SPDX-License-Identifier: Apache-2.0
"""`asglight info` of images says what is read and what is assumed; fits and stages name it too."""

import json
from pathlib import Path

import image_files
import numpy as np
import OpenEXR
import pytest

import asglight
from asglight.cli.main import main
from asglight.images import colour

AP1 = colour.KNOWN["ACEScg (AP1)"]


def two_parts(path: Path, **header: object) -> Path:
    parts = [
        OpenEXR.Part(
            {"type": OpenEXR.scanlineimage, **header}, {"RGB": image_files.ramp(8, 16)}, name
        )
        for name in ("N", "C")
    ]
    OpenEXR.File(parts).write(str(path))
    return path


def test_a_plain_still(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = image_files.write_rgb(tmp_path / "sky.exr", image_files.ramp())
    assert main(["info", str(path)]) == 0
    assert capsys.readouterr().out.splitlines() == [
        f"{path}: 1 frame (1), 8 x 4, openexr",
        "read: layer R, G, B; colours linear Rec.709 (assumed: the file states none)",
    ]


def test_a_sequence_names_layer_colours_notes_and_faults(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for frame in (1, 2, 4):
        two_parts(tmp_path / f"sky.{frame:04d}.exr", chromaticities=AP1, whiteLuminance=100.0)
    image_files.write_rgb(tmp_path / "sky.0005.exr", image_files.ramp(8, 16))
    assert main(["info", str(tmp_path / "sky.####.exr")]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].endswith("sky.####.exr: 5 frames (1-5), 16 x 8, openexr")
    assert lines[1] == "read: layer C (not N); colours ACEScg (AP1) (chromaticities)"
    assert lines[2].startswith("note: whiteLuminance 100 is not applied")
    assert lines[3] == "missing: 1 frame (3)"
    assert "sky.0005.exr: has no layer C" in lines[4]


def test_json_has_the_same(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pixels, _ = image_files.rgbe()
    for frame, exposure in ((1, 1), (2, 2)):
        head = f"#?RADIANCE\nEXPOSURE={exposure}\n\n-Y 4 +X 8\n".encode()
        (tmp_path / f"sky.{frame}.hdr").write_bytes(head + pixels.tobytes())
    assert main(["info", str(tmp_path), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["differing_exposures"]
    assert document["warnings"] == ["no FORMAT line; taken as 32-bit_rle_rgbe"]
    assert (document["layer"], document["stated_by"]) == ("R, G, B", None)
    assert main(["info", str(tmp_path)]) == 0
    assert "exposure: differs from frame to frame, and is divided out of each" in (
        capsys.readouterr().out
    )


def test_fit_and_stage_name_what_was_read(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = two_parts(tmp_path / "sky.exr", chromaticities=AP1)
    stage = str(tmp_path / "sky.usda")
    assert main(["fit", str(path), "-o", stage, "--lobes", "2", "--preset", "live"]) == 0
    line = "image: layer C (not N); colours ACEScg (AP1) (chromaticities)"
    assert line in capsys.readouterr().out.splitlines()
    assert asglight.read_usd(stage).metadata["image"]["layer"] == "C"
    assert main(["info", stage]) == 0
    assert line in capsys.readouterr().out.splitlines()


def test_a_fit_warns_of_what_may_be_wrong_light(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from PIL import Image

    path = tmp_path / "sky.png"
    Image.fromarray(np.full((8, 16, 3), 99, np.uint8)).save(path)
    stage = str(tmp_path / "sky.usda")
    words = ["fit", str(path), "-o", stage, "--lobes", "1", "--preset", "live"]
    assert main([*words, "--input-colorspace", "sRGB"]) == 0
    assert "warning: 8-bit integers: suns and lamps are clipped" in capsys.readouterr().err
    assert main(["info", stage]) == 0
    assert "warning: 8-bit integers" in capsys.readouterr().out


def test_an_infinite_sun_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    values = np.ones((8, 16, 3), np.float16)
    values[3, 4] = np.inf
    path = image_files.write_rgb(tmp_path / "sun.exr", values)
    stage = str(tmp_path / "sun.usda")
    assert main(["fit", str(path), "-o", stage, "--lobes", "2", "--preset", "live"]) == 0
    out, err = capsys.readouterr()
    assert "1 infinite texel taken as 65504, or as the light around" in err
    assert "and 1 infinite texel taken as the brightest in 1 frame (1)" in out
