# SPDX-License-Identifier: Apache-2.0
"""A keyed stage in the viewer: its balls and its map against the image that it was cut from."""

import contextlib
import math
from collections.abc import Iterator
from pathlib import Path

import ball_truth
import moderngl
import numpy as np
import pytest
import torch
from key_cases import Rectangle, corner_error, with_lamps
from keyed_stages import FRAMES, write
from light_edits import scale_amplitude

from asglight.cli.sources.opening import Request, opened
from asglight.errors import InputError
from asglight.images import read_latlong, write_exr
from asglight.lobes import asg
from asglight.sphere import latlong
from asglight.viewer.gl.arrangement import cells
from asglight.viewer.gl.renderer import Renderer
from asglight.viewer.io.saving import edited, save_edits
from asglight.viewer.state.session import Session
from asglight.viewer.uniforms import key_cards

LAMP = Rectangle(20, 30, 15, 20, 9)
ROWS = 64
SIZE = (144, 28)
FRAME = FRAMES[0]

MOST = {0.05: 0.06, 0.1: 0.06, 0.25: 0.03}
"""Of the errors of sharp balls: 0.02 is the noise of their truths, and texels that the lamp's edge
divides have no place in a card."""


@pytest.fixture
def stage(tmp_path: Path) -> Path:
    write_exr(tmp_path / f"sky.{FRAME}.exr", with_lamps(ROWS, LAMP), half=False)
    write(tmp_path, frames=(FRAME,))
    return tmp_path / "shot.usda"


@contextlib.contextmanager
def session_of(stage: Path) -> Iterator[Session]:
    with contextlib.closing(opened(Request(str(stage)))) as session:
        session.state.camera.yaw_deg = session.state.camera.pitch_deg = 0.0
        session.wait()
        yield session


def balls(opengl: moderngl.Context, session: Session, size: tuple[int, int]) -> list[np.ndarray]:
    """Draw until nothing is missing; return each ball.  [S, S, 3]."""
    renderer = Renderer(opengl)
    renderer.balls(session.state, size)
    while renderer.reference_progress < 1:
        renderer.balls(session.state, size)
    picture = renderer.radiance(session.state)
    places = cells(size, len(session.state.balls))
    return [picture[y : y + s, x : x + s] for x, y, s in places]


def l1(found: np.ndarray, truth: np.ndarray) -> float:
    """Return the error within the ball: at its edge the coverage is another estimate."""
    centre = (2 * np.arange(len(found)) + 1) / len(found) - 1
    inside = np.hypot(centre[:, None], centre) < 0.9
    return float(np.abs(found - truth)[inside].sum() / truth[inside].sum())


def test_balls_under_keys_and_rest_are_those_under_the_image(
    opengl: moderngl.Context, stage: Path
) -> None:
    image = read_latlong(stage.parent / f"sky.{FRAME}.exr").radiance.numpy()
    texels = ball_truth.whole(image)
    with session_of(stage) as session:
        np.testing.assert_allclose(session.state.camera.from_environment(), np.eye(3), atol=1e-7)
        assert session.state.tracks.names[0].startswith("key")
        found = balls(opengl, session, SIZE)
        size = len(found[0])
        for ball, seen in zip(session.state.balls, found, strict=True):
            if ball.roughness is None:
                truth = ball_truth.base(texels, size)
            else:
                truth = ball_truth.layer(texels, ball.roughness, size, draws=2)
            assert l1(seen, truth) < MOST.get(ball.roughness or 1.0, 0.01)


def test_a_key_that_is_dimmed_takes_that_much_from_the_balls(
    opengl: moderngl.Context, stage: Path
) -> None:
    with session_of(stage) as session:
        state = session.state
        lit = balls(opengl, session, SIZE)[-1]
        state.history.add(scale_amplitude(0, None, -1.0))
        dimmed = balls(opengl, session, SIZE)[-1]
        state.toggle_mute(0)
        dark = balls(opengl, session, SIZE)[-1]
    np.testing.assert_allclose((lit - dark).sum(), 2 * (dimmed - dark).sum(), rtol=0.01)
    assert (lit - dark).min() > -0.02 * lit.max()  # noise
    assert (lit - dark).sum() > 0.2 * lit.sum()


def test_the_map_is_the_image_and_outlines_are_the_lamp(stage: Path) -> None:
    image = read_latlong(stage.parent / f"sky.{FRAME}.exr").radiance.numpy()
    with session_of(stage) as session:
        keys, rest = session.state.lobes, session.state.rest_image
        assert rest is not None
        shown = key_cards.with_cards(rest, keys)
        [outline] = key_cards.outlines(keys)
    weight = latlong.texel_solid_angles(ROWS, 2 * ROWS).numpy()[..., None]
    error = np.abs(shown - image) * weight
    assert error.sum() < 0.1 * (image * weight).sum()
    np.testing.assert_allclose(
        (shown * weight).sum((0, 1)), (image * weight).sum((0, 1)), rtol=1e-4
    )
    [curve] = outline.curves
    u, v = (torch.from_numpy(curve[:, k].copy()) for k in (0, 1))
    points = latlong.direction_from_uv(u, v).numpy()
    corners = np.stack([points[np.argmax(points @ corner)] for corner in LAMP.corners()])
    assert corner_error(corners, LAMP.corners()) < 0.1 * math.radians(9)


def test_a_card_has_the_flux_of_its_key_where_its_radiance_is_read(stage: Path) -> None:
    with session_of(stage) as session:
        keys = session.state.lobes
    middle = keys.axis_z[0]
    p, q = np.tan(np.radians([10.0, 4.5]))
    solid_angle = 4 * math.atan(p * q / math.sqrt(1 + p * p + q * q))
    # within what the found card's size may be off
    torch.testing.assert_close(
        key_cards.radiance(keys, middle), asg.flux(keys)[0] / solid_angle, rtol=0.1, atol=0
    )
    assert float(key_cards.radiance(keys, -middle).abs().sum()) == 0


def test_edits_of_keys_are_saved_as_a_layer_of_keys(stage: Path) -> None:
    with session_of(stage) as session:
        session.state.history.add(scale_amplitude(0, None, -1.0))
        save_edits(edited(session), stage.parent / "edits.usda")
        before = session.state.history.original
    with session_of(stage.parent / "edits.usda") as session:
        found = session.state.tracks
    assert found.names == before.names
    torch.testing.assert_close(found.lobes.amplitude, before.lobes.amplitude / 2, rtol=1e-4, atol=0)


def test_a_rest_without_its_image_is_told_of(stage: Path) -> None:
    (stage.parent / "shot_dome" / f"shot.rest.{FRAME}.exr").unlink()
    with (
        pytest.raises(InputError, match=r"image of the rest at frame 1001 is not there"),
        session_of(stage),
    ):
        pass


def test_a_stage_that_shows_cards_opens_with_its_lobes(tmp_path: Path) -> None:
    write_exr(tmp_path / f"sky.{FRAME}.exr", with_lamps(ROWS, LAMP), half=False)
    write(tmp_path, frames=(FRAME,), representations=("cards", "keys"))
    with session_of(tmp_path / "shot.usda") as session:
        assert session.state.keyed is None
        assert session.state.tracks.names[0].startswith("lobe")
