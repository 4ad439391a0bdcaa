# SPDX-License-Identifier: Apache-2.0
"""Shots that hold a rig, as text, in all the ways in which a shot can."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from pxr import Usd

from asglight.errors import InputError
from asglight.lobes import LobeTracks
from asglight.usd import read_usd

FRAMES = (1001, 1002, 1003, 1004, 1005)

RIG = "/World/Env"


def shot(
    folder: Path,
    arc: str = "prepend references = @./rig_y.usda@",
    body: str = "",
    *,
    up: str = "Y",
    head: str = "",
    more: str = "",
    start: int = 1001,
    end: int = 1005,
) -> Path:
    """Write a shot with a rig at RIG."""
    path = folder / "shot.usda"
    # a prim begins and ends a line
    body = re.sub(r"\} (?=\})", "}\n", body.replace("{ over", "{\nover"))
    path.write_text(
        f'#usda 1.0\n(\n defaultPrim = "World"\n upAxis = "{up}"\n startTimeCode = {start}\n'
        f" endTimeCode = {end}\n {head}\n)\n"
        f'def Xform "World" {{\n def Xform "Env" (\n  {arc}\n ) {{\n{body}\n }}\n}}\n{more}\n'
    )
    return path


def op(kind: str, value: str) -> str:
    name = f"xformOp:{kind}"
    types = {"rotateX": "double", "rotateY": "double", "transform": "matrix4d"}
    return (
        f'{types.get(kind, "double3")} {name} = {value}\nuniform token[] xformOpOrder = ["{name}"]'
    )


def under(body: str) -> str:
    return f'over "Lobes" {{ over "lobe_02" {{\n{body}\n}} }}'


UNEVEN = op("scale", "(1, 2, 0.5)")
SHEARED = op("transform", "( (1, .4, 0, 0), (0, 1, .3, 0), (0, 0, 1.5, 0), (0, 0, 0, 1) )")

SHOTS: dict[str, Callable[[Path], Path]] = {
    "referenced": lambda folder: shot(folder),
    "payload": lambda folder: shot(folder, "prepend payload = @./rig_y.usda@"),
    "instance": lambda folder: shot(
        folder, "instanceable = true\n prepend references = @./rig_y.usda@"
    ),
    "class": lambda folder: shot(
        folder,
        "inherits = </_Rig>",
        more='class Xform "_Rig" (prepend references = @./rig_y.usda@) {}',
    ),
    "specialized": lambda folder: shot(
        folder,
        "specializes = </_Rig>",
        more='class Xform "_Rig" (prepend references = @./rig_y.usda@) {}',
    ),
    "turned": lambda folder: shot(folder, body=op("rotateXYZ", "(20, 30, 40)")),
    "scaled": lambda folder: shot(folder, body=op("scale", "(0.01, 0.01, 0.01)")),
    "mirrored": lambda folder: shot(folder, body=op("scale", "(-1, 1, 1)")),
    "mirrored through": lambda folder: shot(folder, body=op("scale", "(-2, -2, -2)")),
    "moved": lambda folder: shot(folder, body=op("translate", "(5000, 20, -3000)")),
    "turning": lambda folder: shot(
        folder,
        body="double xformOp:rotateY.timeSamples = { 1001: 0, 1005: 90 }\n"
        'uniform token[] xformOpOrder = ["xformOp:rotateY"]',
    ),
    "z-up, corrected": lambda folder: shot(folder, body=op("rotateX", "90"), up="Z"),
    "z-up, on its side": lambda folder: shot(folder, up="Z"),
    "z-up rig, corrected": lambda folder: shot(
        folder, "prepend references = @./rig_z.usda@", op("rotateX", "-90")
    ),
    "z-up rig, on its side": lambda folder: shot(folder, "prepend references = @./rig_z.usda@"),
    "z-up rig in z-up": lambda folder: shot(folder, "prepend references = @./rig_z.usda@", up="Z"),
    "centimetres": lambda folder: shot(folder, head="metersPerUnit = 0.01"),
    "later and slower": lambda folder: shot(
        folder,
        "prepend references = @./rig_y.usda@ (offset = -1000; scale = 2)",
        start=1000,
        end=1012,
    ),
    "backwards": lambda folder: shot(
        folder, "prepend references = @./rig_y.usda@ (offset = 2006; scale = -1)"
    ),
    "another rate": lambda folder: shot(
        folder, head="timeCodesPerSecond = 48", start=2002, end=2010
    ),
    "warm": lambda folder: shot(
        folder,
        body=under("bool inputs:enableColorTemperature = 1\nfloat inputs:colorTemperature = 2500"),
    ),
    "warmer": lambda folder: shot(
        folder,
        body=under(
            "bool inputs:enableColorTemperature = 1\n"
            "float inputs:colorTemperature.timeSamples = { 1001: 2500, 1005: 9000 }"
        ),
    ),
    "warm fill": lambda folder: shot(
        folder,
        body='over "Fill" (active = true) {\nbool inputs:enableColorTemperature = 1\n'
        "float inputs:colorTemperature = 3000\n}",
    ),
    "exposed": lambda folder: shot(folder, body=under("float inputs:exposure = 1.5")),
    "blinking": lambda folder: shot(
        folder,
        body=under('token visibility.timeSamples = { 1001: "inherited", 1003: "invisible" }'),
    ),
    "hidden": lambda folder: shot(folder, body='token visibility = "invisible"'),
    "normalised": lambda folder: shot(
        folder,
        body=op("scale", "(3, 3, 3)") + "\n" + under("bool inputs:normalize = 1"),
    ),
    "without fill": lambda folder: shot(folder, body='over "Fill" (active = false) {}'),
    "without a card": lambda folder: shot(
        folder, body='over "Lobes" { over "lobe_01" { over "outer" (active = false) {} } }'
    ),
    "without cards": lambda folder: shot(
        folder,
        body='over "Lobes" { over "lobe_01" { over "outer" (active = false) {}\n'
        'over "tall" (active = false) {}\nover "wide" (active = false) {} } }',
    ),
    "a lobe off": lambda folder: shot(
        folder, body='over "Lobes" { over "lobe_01" (active = false) {} }'
    ),
    "turned away": lambda folder: shot(
        folder,
        body=under(
            "double xformOp:rotateX:away = 60\nuniform token[] xformOpOrder = "
            '["xformOp:orient", "xformOp:translate:dist", "xformOp:rotateX:away"]'
        ),
    ),
    "seen from behind": lambda folder: shot(
        folder,
        body=under(
            "double xformOp:rotateX:away = 180\nuniform token[] xformOpOrder = "
            '["xformOp:orient", "xformOp:translate:dist", "xformOp:rotateX:away"]'
        ),
    ),
    "not with the rig": lambda folder: shot(
        folder,
        body=op("rotateY", "50")
        + "\n"
        + under(
            'uniform token[] xformOpOrder = ["!resetXformStack!", "xformOp:orient", '
            '"xformOp:translate:dist"]'
        ),
    ),
    "three rigs deep": lambda folder: (
        shot(folder, body=op("rotateY", "30"), up="Z").rename(folder / "set.usda"),
        shot(
            folder,
            "prepend references = @./set.usda@</World/Env> (offset = 10)",
            op("rotateXYZ", "(80, 5, -20)"),
            up="Z",
            start=1011,
            end=1015,
        ),
    )[1],
}


def assert_alike(found: LobeTracks, wanted: LobeTracks) -> None:
    assert found.frames == wanted.frames
    assert found.names == wanted.names
    for name in ("axes", "sharpness", "amplitude"):
        values = [getattr(tracks.lobes, name).numpy() for tracks in (found, wanted)]
        np.testing.assert_allclose(*values, rtol=2e-5, atol=2e-5)


def refused(path: Path | Usd.Stage) -> str:
    with pytest.raises(InputError) as caught:
        read_usd(path)
    assert "\n" not in str(caught.value)
    return str(caught.value)
