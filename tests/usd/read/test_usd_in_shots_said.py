# SPDX-License-Identifier: Apache-2.0
"""What of a rig in a shot is not read is said, and a shot that holds none says why."""

import numpy as np
import pytest
from rigs_in_shots import (
    RIG,
    assert_alike,
    op,
    refused,
    shot,
    under,
)

from asglight.cli.main import main
from asglight.errors import InputError
from asglight.usd import read_stage, read_usd

SAYS = {
    "light linking": (
        under("prepend rel collection:lightLink:excludes = </World>"),
        "/World/Env/Lobes/lobe_02: lights some prims only (light linking); read as if it lit all",
    ),
    "included only": (
        under("uniform bool collection:lightLink:includeRoot = 0"),
        "/World/Env/Lobes/lobe_02: lights some prims only (light linking); read as if it lit all",
    ),
    "shadow linking": (
        under("prepend rel collection:shadowLink:excludes = </World>"),
        "/World/Env/Lobes/lobe_02: gets shadows from some prims only (shadow linking)",
    ),
    "filters": (
        under("rel light:filters = </World/Blocker>"),
        "/World/Env/Lobes/lobe_02: has light filters (/World/Blocker), which are not read",
    ),
    "portals": (
        'over "Fill" {\nrel portals = </World/Window>\n}',
        "/World/Env/Fill: shines through portals only (/World/Window); read as if open",
    ),
    "diffuse": (
        under("float inputs:diffuse = 0.5"),
        "/World/Env/Lobes/lobe_02: has multipliers of 0.5 on diffuse and 1 on specular reflection; "
        "a lobe lights both alike, and is read without them",
    ),
    "shaping": (
        under("float inputs:shaping:cone:angle = 10"),
        "/World/Env/Lobes/lobe_02: is shaped by a cone, focus or IES profile; read as it shines "
        "without",
    ),
    "missing image": (
        'over "Fill" {\nasset inputs:texture:file = @./rig_y_dome/gone.exr@\n}',
        "/World/Env/Fill: has the image ./rig_y_dome/gone.exr, which is not there; read as its "
        "lobes say",
    ),
    "another image": (
        'over "Fill" {\nasset inputs:texture:file = @./shot.usda@\n}',
        "/World/Env/Fill: has an image of another origin (./shot.usda); read as its lobes say",
    ),
    "normalised dome": (
        'over "Fill" {\nbool inputs:normalize = 1\n}',
        "/World/Env/Fill: is a normalised dome, which programs show differently; read as if it "
        "were not",
    ),
    "purpose": (
        'uniform token purpose = "guide"',
        "/World/Env: has the purpose guide, which renderers leave out",
    ),
    "a lobe of the fill off": (
        'over "Lobes" { over "lobe_00" (active = false) {} }',
        "/World/Env/Lobes/lobe_00: is off, and its light is in the image of Fill; read without it",
    ),
    "a lobe of the fill hidden": (
        'over "Lobes" { over "lobe_00" {\ntoken visibility = "invisible"\n} }',
        "/World/Env/Lobes/lobe_00: is off, and its light is in the image of Fill; read without it",
    ),
}


@pytest.mark.parametrize("name", SAYS)
def test_what_lobes_cannot_hold_is_said(name, folder):
    body, line = SAYS[name]
    assert read_stage(shot(folder, body=body)).unread == (line,)


@pytest.mark.parametrize("name", ["light linking", "portals"])
def test_commands_say_what_lobes_cannot_hold(name, folder, capsys):
    body, line = SAYS[name]
    path = shot(folder, body=body)
    assert main(["info", str(path)]) == 0
    assert f"not read: {line}" in capsys.readouterr().out
    assert main(["export", str(path), "--to", "json", "-o", str(folder / "lobes.json")]) == 0
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert error.startswith(f"asglight: {path}: not read: {line}")


def test_multipliers_of_all_reflection_are_light(folder):
    half = shot(folder, body=under("float inputs:diffuse = 0.5\nfloat inputs:specular = 0.5"))
    reading, rig = read_stage(half), read_usd(folder / "rig_y.usda")
    assert reading.unread == ()
    ratio = reading.tracks.lobes.amplitude[:, 2] / rig.lobes.amplitude[:, 2]
    np.testing.assert_allclose(ratio, 0.5, rtol=1e-4)


def test_the_representation_that_is_not_there_is_said(folder):
    arc = 'variants = {\n string representation = "cubes"\n}\nprepend references = @./rig_y.usda@'
    assert read_stage(shot(folder, arc)).unread == (
        "/World/Env: selects the representation cubes, which has no lights; read as its lobes say",
    )


def test_lights_beside_the_rig_are_said(folder):
    more = 'def SphereLight "Key" {}\ndef SphereLight "Rim" {}\ndef DistantLight "Sun" {}'
    assert read_stage(shot(folder, more=more)).unread == (
        "/World/Env: lights beside it are not read (1 DistantLight, 2 SphereLight)",
    )


def test_a_rig_in_a_point_instancer_is_said(folder):
    path = shot(folder)
    path.write_text(path.read_text().replace('def Xform "World"', 'def PointInstancer "World"'))
    (line,) = read_stage(path).unread
    assert line == "/World/Env: stands in a PointInstancer: read once, where it is written"


NONE = {
    "gone": ("prepend references = @./gone.usda@", "", "refers to ./gone.usda, which is not there"),
    "payload gone": ("prepend payload = @./gone.usda@", "", "refers to ./gone.usda, which is not"),
    "deactivated": (
        "active = false\nprepend references = @./rig_y.usda@",
        "",
        "has /World/Env deactivated and shows no lobes; expected an active rig. Activate it.",
    ),
    "lobes deactivated": (
        "prepend references = @./rig_y.usda@",
        'over "Lobes" (active = false) {}',
        "has /World/Env/Lobes deactivated and shows no lobes",
    ),
}


@pytest.mark.parametrize("name", NONE)
def test_a_shot_without_lobes_says_why(name, folder, capfd):
    arc, body, message = NONE[name]
    assert message in refused(shot(folder, arc, body))
    assert capfd.readouterr().err == ""  # USD's own warnings are in the message


def test_a_class_that_nothing_inherits_says_so(folder):
    path = folder / "class.usda"
    path.write_text('#usda 1.0\nclass "_Rig" (\n references = @./rig_y.usda@\n) {}\n')
    assert "has lobes at /_Rig, which is a class, and USD shows none of it" in refused(path)
    path.write_text('#usda 1.0\nover "AsgRig" (\n references = @./rig_y.usda@\n) {}\n')
    assert read_usd(path).lobes.count == 3  # the reference defines it


def test_of_several_rigs_one_is_named(folder, capsys):
    path = shot(
        folder, more='def "Other" (\n instanceable = true\n references = @./rig_z.usda@\n) {}'
    )
    message = refused(path)
    assert "holds 2 rigs (/World/Env, /Other), whose light adds up; expected one." in message
    assert message.endswith("Name the one to read: --rig /World/Env.")
    with pytest.raises(InputError, match="/World holds no lobes; /World/Env, /Other does"):
        read_usd(path, "/World")
    for command in (["info", "--json"], ["export", "--to", "json", "-o", str(folder / "l.json")]):
        assert main([command[0], str(path), *command[1:], "--rig", RIG]) == 0
    assert "lights beside it are not read (1 DomeLight, 4 RectLight)" in capsys.readouterr().err
    assert_alike(read_usd(path, RIG), read_usd(folder / "rig_y.usda"))


def test_a_rig_without_extent_is_refused(folder):
    path = shot(folder, body=op("scale", "(1, 0, 1)"))
    assert "/World/Env has no extent, or no end, at frame 1001" in refused(path)
