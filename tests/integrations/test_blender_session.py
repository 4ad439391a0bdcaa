# SPDX-License-Identifier: Apache-2.0
"""The Blender extension in Blender: installed, used as an artist would, and what it leaves."""

import json
import os
import subprocess
import sys
from typing import Any

import pytest
import torch
from places import ROOT
from usd_tracks import of_every_kind

from asglight.images import write_exr
from asglight.sky import SkyConfig, radiance
from asglight.usd import read_stage, read_usd, write_usd
from dcc import renderers
from integrations.package import packed

pytestmark = [
    pytest.mark.slow,
    pytest.mark.blender,
    pytest.mark.skipif(not renderers.PYTHON.is_file(), reason="no Blender: make setup-dcc"),
]


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    folder = tmp_path_factory.mktemp("session")
    stage = folder / "shot.usda"
    write_usd(of_every_kind((1001, 1002, 1003)), stage, dome_height=16)
    image = folder / "sky.exr"
    write_exr(image, radiance(SkyConfig(), 1001, 16))
    command = folder / "asglight"
    command.write_text(
        f"#!/bin/sh\nPYTHONPATH={ROOT} exec {sys.executable} -c "
        "'import sys; from asglight.cli.main import main; sys.exit(main())' \"$@\" --lobes 3\n"
    )
    command.chmod(0o755)
    line = [renderers.PYTHON, ROOT / "tests" / "support" / "blender_session.py"]
    done = subprocess.run(
        [*map(str, line), str(packed(folder)), str(stage), str(image), str(command), str(folder)],
        env=os.environ | {"PATH": "/usr/bin:/bin"},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    return json.loads((folder / "session.json").read_text()) | {"folder": folder}


def test_the_zip_installs_and_handles_dropped_stages(session: dict[str, Any]) -> None:
    assert session["enabled"]
    assert session["handler"] == "ASGLIGHT_FH_stage"
    assert session["dropped"] == ["shot.usda", "Import"]


def test_lights_are_named_after_their_lobe_and_stand_where_asked(session: dict[str, Any]) -> None:
    assert "lobe_00" in session["names"]
    assert "lobe_02 light" in session["names"]
    assert not any(".0" in name for name in session["names"])
    assert session["distances"] == pytest.approx([20.0] * len(session["distances"]), rel=3e-3)
    assert session["hidden"]  # broad lobes of a sky shine from the fill
    assert session["range"] == [1101, 1103, 24]
    assert session["world"] == "asglight shot"
    assert session["collections"] == ["shot"]


def test_a_second_import_keeps_what_is_the_user_s(session: dict[str, Any]) -> None:
    again = session["again"]
    assert again["distance"] == pytest.approx(40.0, rel=3e-3)
    assert again["objects"] == 0
    assert again["name"] == "my sun"
    assert (again["gain"], again["energy"]) == (2.5, pytest.approx(2.5, rel=1e-5))
    assert again["linked"]
    assert again["hidden"]
    assert session["opened"] == pytest.approx(2.5, rel=1e-5)  # saved, and opened again


def test_what_an_older_stage_hid_is_shown_again(session: dict[str, Any]) -> None:
    dark, again = session["blinking"]
    assert all(dark)
    assert again == [*([False] * (len(dark) - 1)), True]  # the last one was hidden by the user


def test_read_again_hands_over_how_the_rig_was_imported(session: dict[str, Any]) -> None:
    assert session["handed"] == [[True, True, False], [False, False, True]]


def test_a_representation_that_is_not_there_is_refused(session: dict[str, Any]) -> None:
    assert (
        "holds cards, not dome; add it with: asglight export STAGE --to dome"
        in (session["refused"])
    )


def test_a_stage_that_is_none_of_ours_is_refused(session: dict[str, Any]) -> None:
    assert "no lobes of asglight; expected a stage that asglight wrote" in session["other"]
    assert "absent.usda: no such file; expected a stage" in session["absent"]


def test_light_that_blender_cannot_show_is_told_of(session: dict[str, Any]) -> None:
    told = session["warned"]
    assert told[0].startswith(
        "not taken over, no light that asglight writes: /AsgRig/Lobes/lobe_01"
    )
    assert "have a texture, which Blender's lights leave out" in told[1]
    assert told[2] == (
        "images of the dome are taken for Rec.709; Blender has no lin_adobergb_scene"
    )
    assert told[3] == "colours are taken for Rec.709; lin_ciexyzd65_scene is unknown here"


def test_a_new_world_is_black_where_the_stage_has_no_dome(session: dict[str, Any]) -> None:
    # no World; one made by hand; one of a new file; one that somebody chose stays
    assert session["greys"] == [True, True, 0, True, 0, False, pytest.approx(0.2)]


def test_edits_come_back_as_what_was_done(session: dict[str, Any]) -> None:
    assert session["unchanged"] == "CANCELLED"
    assert "is the stage itself; expected another name" in session["over"]
    assert "a Point light now; expected Area" in session["point"]
    assert "was imported with strength 0" in session["dark"]
    assert not (session["folder"] / "none.usda").exists()
    path = session["folder"] / "edits.usda"
    changes = read_stage(path).changes
    (edited,) = [one for one in changes if one.startswith("/AsgRig/Lobes/lobe_01: ")]
    assert "light x 2" in edited
    assert "width x 1." in edited
    assert "/AsgRig: turned by 30 degrees with all its lobes" in changes


def test_a_world_is_fitted_where_it_is(session: dict[str, Any]) -> None:
    assert not session["no image"]
    assert "asglight: no such command" in session["no command"]
    assert "is a mirror ball; expected an equirectangular image" in session["ball"]
    assert session["fitted"] == "FINISHED"
    assert "is not on disk; save or unpack it first" in session["packed"]
    assert "tilts or scales the World; expected a turn about Z alone" in session["tilted"]
    assert "expected a Mapping of type Point, or none" in session["normal"]
    assert "the World changes its image before it shines" in session["changed"]
    assert "no folder" in session["failed"]  # the command's own line
    assert session["turn"] == pytest.approx(90.0)
    assert session["strength"] == pytest.approx(3.0)
    assert session["world after"] == "asglight fitted"
    tracks = read_usd(session["folder"] / "fitted.usda")
    assert torch.isfinite(tracks.lobes.amplitude).all()


def test_a_fit_ends_with_the_file_it_was_started_in(session: dict[str, Any]) -> None:
    assert session["left"] == [True, True]
