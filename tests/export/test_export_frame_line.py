# SPDX-License-Identifier: Apache-2.0
"""The JSON line of a live frame, against scipy's rotations and closed forms."""

import json
import math

import numpy as np
import torch
from scipy.spatial.transform import Rotation
from usd_tracks import moving

from asglight.export.frame_line import frame_line
from asglight.lobes import Form, Lobes

SHOT = moving([1001])


def test_a_line_says_each_lobe_to_the_bit_of_float32() -> None:
    lobes = SHOT.at(1001)
    line = frame_line(lobes, SHOT.names, frame=1001, dropped=2)
    assert "\n" not in line
    document = json.loads(line)
    assert list(document) == ["format", "version", "frame", "dropped", "form", "lobes"]
    assert (document["format"], document["version"]) == ("asglight frame", 1)
    assert (document["frame"], document["dropped"], document["form"]) == (1001, 2, "asg")
    assert [row["name"] for row in document["lobes"]] == list(SHOT.names)
    for place, row in enumerate(document["lobes"]):
        assert list(row) == [
            "name", "quaternion", "direction", "sharpness", "amplitude", "flux", "width_deg"
        ]  # fmt: skip
        for name in ("sharpness", "amplitude"):
            assert np.float32(row[name]).tolist() == getattr(lobes, name)[place].tolist()
        assert np.float32(row["direction"]).tolist() == lobes.axis_z[place].tolist()
        w, x, y, z = row["quaternion"]
        turned = Rotation.from_quat([x, y, z, w]).as_matrix().T
        np.testing.assert_allclose(turned, lobes.axes[place], atol=1e-6)


def test_flux_and_width_of_a_narrow_lobe_are_those_of_a_gaussian() -> None:
    sharpness = torch.tensor([[4000.0, 1000.0]])
    lobes = Lobes(torch.eye(3)[None], sharpness, torch.tensor([[2.0, 1.0, 0.0]]), Form.ASG)
    (row,) = json.loads(frame_line(lobes, ["sun"]))["lobes"]
    flux = math.pi / math.sqrt(4000 * 1000)
    np.testing.assert_allclose(row["flux"], [2 * flux, flux, 0], rtol=1e-6)
    width = math.degrees(math.sqrt(1 / 8000 + 1 / 2000))  # of two variances, 1 / 2 s
    np.testing.assert_allclose(row["width_deg"], width, rtol=1e-3)


def test_a_black_lobe_is_there_and_sends_nothing() -> None:
    lobes = Lobes(torch.eye(3)[None], torch.ones(1, 2), torch.zeros(1, 3), Form.ASG)
    (row,) = json.loads(frame_line(lobes, ["lobe_00"]))["lobes"]
    assert row["amplitude"] == row["flux"] == [0.0, 0.0, 0.0]
