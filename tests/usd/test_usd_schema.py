# SPDX-License-Identifier: Apache-2.0
"""The codeless schema: what is shipped is what usdGenSchema makes, and USD takes it up."""

import importlib.util
import json
import os
import subprocess
import sys

import pytest
from pxr import Sdf
from usd_tracks import moving

from asglight.lobes import Form
from asglight.usd import SCHEMA_FOLDER, schema, write_usd


def fields(path) -> dict[str, tuple]:
    """Return type, variability, default and allowed tokens of each attribute of the API."""
    layer = Sdf.Layer.FindOrOpen(str(path))
    assert [prim.name for prim in layer.rootPrims] == ["AsgLobeAPI"]
    return {
        attribute.name: (
            attribute.typeName,
            attribute.variability,
            attribute.default,
            list(attribute.allowedTokens),
        )
        for attribute in layer.GetPrimAtPath("/AsgLobeAPI").attributes
    }


@pytest.mark.skipif(importlib.util.find_spec("jinja2") is None, reason="usdGenSchema needs jinja2")
def test_the_generated_schema_is_what_the_source_gives(tmp_path):
    subprocess.run(
        [sys.executable, "-m", "pxr.Usd.usdGenSchema", SCHEMA_FOLDER / "schema.usda", tmp_path],
        check=True,
        capture_output=True,
    )
    # documentation is left out: releases of USD store it in different fields
    assert fields(tmp_path / "generatedSchema.usda") == fields(
        SCHEMA_FOLDER / "generatedSchema.usda"
    )
    made = (tmp_path / "plugInfo.json").read_text()
    made = "\n".join(line for line in made.splitlines() if not line.startswith("#"))
    shipped = json.loads((SCHEMA_FOLDER / "plugInfo.json").read_text())
    (made_plugin,), (shipped_plugin,) = json.loads(made)["Plugins"], shipped["Plugins"]
    assert shipped_plugin["Info"] == made_plugin["Info"]
    assert "@" not in (SCHEMA_FOLDER / "plugInfo.json").read_text()


def test_the_schema_declares_what_the_writer_authors():
    declared = fields(SCHEMA_FOLDER / "generatedSchema.usda")
    assert set(declared) == {schema.SHARPNESS, schema.AMPLITUDE, schema.FORM}
    for name, (kind, variability, _, allowed) in declared.items():
        assert kind == schema.VALUE_TYPES[name]
        assert (variability == Sdf.VariabilityUniform) == (name in schema.UNIFORM)
        assert allowed == (list(Form) if name == schema.FORM else [])


def test_usd_knows_the_api_where_the_plugin_path_names_the_schema(tmp_path):
    path = tmp_path / "shot.usda"
    write_usd(moving(range(3)), path, representations=("distant",))
    code = (
        "from pxr import Usd; import sys; s = Usd.Stage.Open(sys.argv[1]);"
        "lobe = s.GetPrimAtPath('/AsgRig/Lobes/lobe_00');"
        "names = lobe.GetPrimDefinition().GetPropertyNames();"
        "print(lobe.HasAPI('AsgLobeAPI'), 'asg:form' in names,"
        " lobe.GetAttribute('asg:form').IsCustom())"
    )
    result = subprocess.run(
        [sys.executable, "-c", code, str(path)],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "PXR_PLUGINPATH_NAME": str(SCHEMA_FOLDER)},
    )
    assert (result.stdout.split(), result.stderr) == (["True", "True", "False"], "")
