# SPDX-License-Identifier: Apache-2.0
"""A layer of edits over a stage whose lobes have three distant lights each."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from pxr import Usd, UsdGeom, UsdLux
from usd_tracks import moving
from written_stages import calm

from asglight.lobes import Form
from asglight.usd import lint_stage, read_usd, write_edit_layer, write_usd


def distants(path) -> dict[str, tuple]:
    """Return direction, angle and colour of every distant light at the frames 1 and 3."""
    stage = Usd.Stage.Open(str(path))
    found = {}
    for prim in stage.Traverse():
        if prim.GetTypeName() == "DistantLight":
            for frame in (1, 3):
                light = UsdLux.DistantLight(prim)
                matrix = UsdGeom.XformCache(frame).GetLocalToWorldTransform(prim)
                found[f"{prim.GetPath()}@{frame}"] = (
                    *np.array(matrix)[2, :3],
                    light.GetAngleAttr().Get(frame),
                    *(light.GetIntensityAttr().Get(frame) * light.GetColorAttr().Get(frame)),
                )
    return found


@pytest.mark.parametrize("form", [Form.ASG, Form.BINGHAM])
def test_three_distant_lights_follow_an_edit(form, tmp_path):
    chosen = {"representations": ("distant",), "distant_lights": 3}
    write_usd(calm(moving, (1, 2, 3), form=form), tmp_path / "a.usda", **chosen)
    tracks = read_usd(tmp_path / "a.usda")
    lobes = tracks.lobes.clone()
    lobes.sharpness[:, 1] *= torch.tensor([0.5, 3.0])
    lobes.amplitude[:, 1] *= 2
    after = replace(tracks, lobes=lobes)
    write_edit_layer(tmp_path / "edit.usda", tmp_path / "a.usda", after, [1])
    write_usd(after, tmp_path / "direct.usda", **chosen)
    assert lint_stage(tmp_path / "edit.usda") == []
    found, wanted = distants(tmp_path / "edit.usda"), distants(tmp_path / "direct.usda")
    assert len(found) == 2 * 3 * 3 * (2 if form is Form.BINGHAM else 1)
    assert found.keys() == wanted.keys()
    swapped = {"plus": "minus", "minus": "plus"}
    for name, values in wanted.items():
        if not np.allclose(found[name][:3], values[:3], atol=1e-3):
            # an edit keeps the lobe's x axis, along which it is no longer the longer one: the two
            # at the sides have exchanged their names
            side = next(one for one in swapped if f"/{one}@" in name.replace("_", "/"))
            name = name.replace(side, swapped[side])
        # samples left out, 2e-5 each, and an override of the difference left out
        np.testing.assert_allclose(found[name], values, rtol=1e-4, atol=1e-5, err_msg=name)
