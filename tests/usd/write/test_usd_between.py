# SPDX-License-Identifier: Apache-2.0
"""What a program reads between frames, against lobes in motion.

Stages are written and read back by pxr at many times between frames. The lights of a time are those
that USD interpolates, attribute by attribute; what they send is told by UsdLux's own formulas, by
quadrature where they have shapes. What they should be are the lights of the lobe at that time.
"""

import functools
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch
from pxr import Usd, UsdGeom
from scipy.spatial.transform import Rotation, Slerp
from usd_tracks import moving, of_every_kind, rows

from asglight.lobes import Form, Lobes, LobeTracks, asg, frames, motion
from asglight.usd import read_usd, schema, write_usd
from asglight.usd.lights import cards, distant
from asglight.usd.read.between import read_between, samples_between
from asglight.usd.write.between import Shot
from asglight.usd.write.layer import continuous

FRAMES = range(1001, 1004)
TIMES = [
    frame + part
    for frame in FRAMES[:-1]
    for part in (0.02, 0.1, 0.23, 0.4, 0.5, 0.62, 0.74, 0.77, 0.9, 0.98)
]

FLUX, RADIANCE, TURN_DEG = 3e-3, 1e-2, 0.1

FAINT = 0.01
"""Of the light of all lobes; one with less counts as having it."""


def written(tracks: LobeTracks, folder, representation: str = "cards", **options) -> Usd.Stage:
    path = folder / "shot.usda"
    write_usd(tracks, path, representations=(representation,), **options)
    return Usd.Stage.Open(str(path))


def number(prim: Usd.Prim, name: str, time: float) -> np.ndarray:
    return np.asarray(prim.GetAttribute(name).Get(time), dtype=np.float64)


def axes_of(prim: Usd.Prim, time: float) -> np.ndarray:
    """Return rows x, y, z of a prim's frame in the stage."""
    matrix = UsdGeom.XformCache(time).GetLocalToWorldTransform(prim)
    rows = np.array(matrix)[:3, :3]
    return rows / np.linalg.norm(rows, axis=-1, keepdims=True)


def apart_deg(one: np.ndarray, other: np.ndarray) -> float:
    chord = np.linalg.norm(one - other)
    return float(np.degrees(2 * np.arcsin(min(1.0, chord / 2))))


def lobe_of(prim: Usd.Prim, time: float, form: Form) -> Lobes:
    """Return the lobe that USD interpolates.  [1, .]."""
    return Lobes(
        torch.from_numpy(axes_of(prim, time))[None],
        torch.from_numpy(number(prim, schema.SHARPNESS, time))[None],
        torch.from_numpy(number(prim, schema.AMPLITUDE, time))[None],
        form,
    )


def radiance_error(lobe: Lobes, wanted: Lobes) -> float:
    """Integrate the difference of two lobes over the sphere, over the flux of the one wanted.

    On a grid in the plane that the lobe's own directions are projected to, evenly in units of its
    width, which reaches four of them.
    """
    nodes, weights = np.polynomial.legendre.leggauss(32)
    reach = np.minimum(1, 4 / np.sqrt(2 * wanted.sharpness[0].numpy()))
    x, y = np.meshgrid(reach[0] * nodes, reach[1] * nodes, indexing="ij")
    area = np.outer(reach[0] * weights, reach[1] * weights)
    inside = x**2 + y**2 < 1
    x, y, area = x[inside], y[inside], area[inside]
    z = np.sqrt(1 - x**2 - y**2)
    directions = torch.from_numpy(np.stack([x, y, z], -1)) @ wanted.axes[0]
    shown, true = (asg.evaluate(one, directions).numpy() for one in (lobe, wanted))
    omega = (area / z)[:, None]
    return float((np.abs(shown - true) * omega).sum() / (true * omega).sum())


def in_order(tracks: LobeTracks) -> Lobes:
    """Return the lobes at all times, of equal axes those that the stage has."""
    return motion.at(replace(tracks, lobes=continuous(tracks.lobes)), TIMES)


def weights(tracks: LobeTracks) -> np.ndarray:
    """Return by how much errors of each lobe count at all times.  [T, N]."""
    flux = asg.flux(motion.at(tracks, TIMES)).sum(-1).numpy()
    return flux / np.maximum(flux, FAINT * flux.sum(-1, keepdims=True))


def rect(prim: Usd.Prim, time: float) -> tuple[np.ndarray, np.ndarray]:
    """Return half extents at distance 1, and radiance."""
    distance = prim.GetAttribute(schema.TRANSLATE).Get()[2]
    size = [number(prim, name, time) for name in (schema.WIDTH, schema.HEIGHT)]
    light = number(prim, schema.INTENSITY, time) * number(prim, schema.COLOR, time)
    return np.array(size) / (2 * distance), light


def rect_angle(extent: np.ndarray) -> float:
    p, q = extent
    return 4 * np.arctan(p * q / np.sqrt(1 + p * p + q * q))


def even_error(one: tuple[float, np.ndarray], other: tuple[float, np.ndarray], common: float):
    """Return errors of flux and radiance of two even lights about one centre."""
    (angle, light), (true_angle, true_light) = one, other
    flux, true = angle * light.sum(), true_angle * true_light.sum()
    apart = np.abs(light - true_light).sum() * common
    apart += light.sum() * (angle - common) + true_light.sum() * (true_angle - common)
    return abs(flux / true - 1), apart / true


def bent() -> LobeTracks:
    """Return lobes whose spread is least between two frames, or stops growing there."""
    sharpness = [
        [[7.1, 600.0], [70.5, 6.8]],
        [[109.0, 0.39], [0.42, 4.1]],
        [[800.0, 3.0], [1e5, 90]],
    ]
    shape = torch.tensor(sharpness)
    axes = torch.eye(3).expand(3, 2, 3, 3)
    light = shape.prod(-1, keepdim=True).sqrt().expand(3, 2, 3)
    lobes = Lobes(axes, shape, light, Form.FLAT)
    return LobeTracks(tuple(FRAMES), 24.0, lobes)


def tinted() -> LobeTracks:
    """Return lobes that change their light and keep their shapes."""
    tracks = of_every_kind(FRAMES)
    tracks.lobes.sharpness[:] = tracks.lobes.sharpness[:1].clone()
    tracks.lobes.amplitude[1::2] *= torch.tensor([0.02, 0.5, 3.0])
    return tracks


def cases() -> dict[str, LobeTracks]:
    noisy = moving(FRAMES, 6, jitter=0.3)
    wild = moving(FRAMES, 4, seed=3)
    wild.lobes.sharpness[::2] *= 20
    wild.lobes.amplitude[1::2] *= 30
    return {
        "kinds": of_every_kind(FRAMES),
        "noisy": noisy,
        "wild": wild,
        "bingham": moving(FRAMES, 3, Form.BINGHAM, jitter=0.2),
        "sg": moving(FRAMES, 3, Form.SG, jitter=0.2),
        "bent": bent(),
        "tinted": tinted(),
    }


CASES = cases()

TEXTURED = [("kinds", True), ("wild", True)]
"""Those with lobes as narrow as that."""

Stages = Callable[..., Usd.Stage]


@pytest.fixture(scope="module")
def stage_of(tmp_path_factory: pytest.TempPathFactory) -> Stages:
    """Return what opens the stage of a case, which is written once."""

    @functools.cache
    def stage(name: str, representation: str = "cards", **options: int) -> Usd.Stage:
        folder = tmp_path_factory.mktemp("between")
        return written(CASES[name], folder, representation, **options)

    return stage


@pytest.mark.parametrize("name", CASES)
def test_lobes_between_frames_are_those_in_motion(name: str, stage_of: Stages) -> None:
    tracks = CASES[name]
    stage = stage_of(name, card_texture=False)
    wanted, weight = motion.at(tracks, TIMES), weights(tracks)
    for index, lobe_name in enumerate(tracks.names):
        prim = stage.GetPrimAtPath(f"/AsgRig/Lobes/{lobe_name}")
        for place, time in enumerate(TIMES):
            true = wanted[place].select(torch.tensor([index]))
            found = lobe_of(prim, time, true.form)
            ratio = asg.flux(found).sum() / asg.flux(true).sum()
            assert weight[place, index] * abs(float(ratio) - 1) < FLUX
            axis, true_axis = found.axis_z[0].numpy(), true.axis_z[0].numpy()
            if true.form is Form.BINGHAM:
                axis = axis * np.sign(axis @ true_axis)
            assert apart_deg(axis, true_axis) < TURN_DEG
            assert weight[place, index] * radiance_error(found, true) < RADIANCE


@pytest.mark.parametrize(("name", "textured"), [*((name, False) for name in CASES), *TEXTURED])
def test_cards_between_frames_are_those_of_lobes_in_motion(name, textured, stage_of) -> None:
    tracks = CASES[name]
    stage = stage_of(name, card_texture=textured)
    kinds = cards.kinds(tracks.lobes, textured=textured)
    assert textured is (cards.Kind.TEXTURED in kinds)
    lobes, weight = in_order(tracks), weights(tracks)
    lights = cards.lights(lobes, asg.moments(lobes), 1000.0, kinds)
    for index, lobe_name in enumerate(tracks.names):
        for light in lights[index]:
            path = "/".join(filter(None, [f"/AsgRig/Lobes/{lobe_name}", light.name]))
            prim = stage.GetPrimAtPath(path)
            for place, time in enumerate(TIMES):
                extent, shown = rect(prim, time)
                sizes = [light.tracks[one][place, 0] for one in (schema.WIDTH, schema.HEIGHT)]
                distance = light.constants[schema.TRANSLATE][2]
                wanted = np.array([float(size) for size in sizes]) / (2 * distance)
                true = (light.tracks[schema.INTENSITY] * light.tracks[schema.COLOR])[place].numpy()
                flux, apart = even_error(
                    (rect_angle(extent), shown),
                    (rect_angle(wanted), true),
                    rect_angle(np.minimum(extent, wanted)),
                )
                assert weight[place, index] * flux < FLUX
                assert weight[place, index] * apart < RADIANCE


@pytest.mark.parametrize(
    ("name", "count"),
    # the round sg has one light in any case
    [
        *((name, count) for name in ("kinds", "noisy", "wild", "tinted") for count in (1, 3)),
        ("sg", 3),
        ("bent", 1),
    ],
)
def test_distant_lights_between_frames_are_those_of_lobes_in_motion(name, count, stage_of) -> None:
    tracks = CASES[name]
    stage = stage_of(name, "distant", distant_lights=count)
    threefold = distant.threefold(tracks.lobes, count)
    lobes, weight = in_order(tracks), weights(tracks)
    lights = distant.lights(lobes, asg.moments(lobes), threefold)
    for index, lobe_name in enumerate(tracks.names):
        for light in lights[index]:
            path = "/".join(filter(None, [f"/AsgRig/Lobes/{lobe_name}", light.name]))
            prim = stage.GetPrimAtPath(path)
            for place, time in enumerate(TIMES):
                half = np.radians(number(prim, schema.ANGLE, time)) / 2
                facing = number(prim, schema.INTENSITY, time) * number(prim, schema.COLOR, time)
                true_half = np.radians(float(light.tracks[schema.ANGLE][place, 0])) / 2
                true = (light.tracks[schema.INTENSITY] * light.tracks[schema.COLOR])[place].numpy()
                pair = [
                    (2 * np.pi * (1 - np.cos(one)), value / (np.pi * np.sin(one) ** 2))
                    for one, value in ((half, facing), (true_half, true))
                ]
                flux, apart = even_error(*pair, min(pair[0][0], pair[1][0]))
                assert weight[place, index] * flux < FLUX
                assert weight[place, index] * apart < RADIANCE


def test_nothing_lies_between_frames_where_lights_keep_their_shape(tmp_path) -> None:
    tracks = moving(range(1001, 1021), 3)  # by less than 10 degrees a frame
    tracks.lobes.sharpness[:] = tracks.lobes.sharpness[:1].clone()
    for frame in range(1, 20):  # not about themselves
        before, axis_z = tracks.lobes.axes[frame - 1], tracks.lobes.axis_z[frame]
        tracks.lobes.axes[frame] = frames.parallel_transport(before, axis_z)
    report = write_usd(tracks, tmp_path / "shot.usda")
    assert report.samples_written > 0  # they turn and brighten
    assert report.samples_between == 0


@pytest.mark.parametrize(
    ("swing", "twist", "is_lit", "samples"),
    [
        (20.0, 0.0, True, 0),
        (0.0, 40.0, True, 0),
        (20.0, 40.0, True, 6),  # 1.8 degrees off; in seven steps a 49th of it
        (20.0, 40.0, False, 6),
        (4.0, 10.0, True, 1),
        (2.0, 5.0, True, 0),
    ],
)
def test_a_lobe_that_turns_about_its_direction_has_samples_on_its_way(
    swing: float, twist: float, is_lit: bool, samples: int
) -> None:
    start = Rotation.from_rotvec([0.4, 0.1, -0.3])
    spun = start * Rotation.from_rotvec([0, 0, np.radians(twist)])
    end = Rotation.from_rotvec(np.radians(swing) * start.apply([1.0, 0, 0])) * spun
    axes = torch.from_numpy(np.stack([rows(one)[None] for one in (start, end)]))
    light = torch.ones(2, 1, 3, dtype=torch.float64)
    light[1] *= float(is_lit)
    shape = torch.tensor([30.0, 10.0], dtype=torch.float64).expand(2, 1, 2)
    (lobe,) = Shot(Lobes(axes, shape, light), np.array([1.0, 2.0])).of_lobes()
    track = lobe.turns
    assert (len(track.times), len(lobe.shape.times)) == (2 + samples, 2)
    turns = Rotation.from_matrix(track.lobes.axes[:, 0].mT.numpy())
    times = np.linspace(1, 2, 101)
    shown = Slerp(track.times, turns)(times).apply([0.0, 0, 1])
    ends = [one.apply([0.0, 0, 1]) for one in (start, end)]
    axis = np.cross(*ends) if swing else np.array([1.0, 0, 0])
    ways = np.radians(swing) * (times - 1)[:, None] * axis / np.linalg.norm(axis)
    wanted = Rotation.from_rotvec(ways).apply(ends[0])
    assert np.degrees(np.linalg.norm(shown - wanted, axis=-1)).max() < TURN_DEG / 2


def test_a_light_that_flares_up_is_off_beside_the_darker_frame_alone(tmp_path) -> None:
    """As docs/reference/stage.md says, by 1/512 of the brighter frame's flux at most."""
    shape, dark, bright = torch.full((2, 1, 2), 50.0), [1.0, 1.0, 1.0], [0.1, 0.1, 1200.0]
    light = torch.tensor([[dark], [bright]])
    tracks = LobeTracks((1, 2), 24.0, Lobes(torch.eye(3).expand(2, 1, 3, 3), shape, light))
    stage = written(tracks, tmp_path, "distant")
    prim = stage.GetPrimAtPath("/AsgRig/Lobes/lobe_00")
    ends = [
        number(prim, schema.INTENSITY, time) * number(prim, schema.COLOR, time) for time in (1, 2)
    ]
    shares = []
    for part in np.arange(1, 1024) / 1024:
        shown = number(prim, schema.INTENSITY, 1 + part) * number(prim, schema.COLOR, 1 + part)
        true = (1 - part) * ends[0] + part * ends[1]
        assert np.abs(shown - true).sum() <= 1.001 / 512 * ends[1].sum()
        shares.append(float(np.abs(shown - true).sum() / true.sum()))
    assert 0.3 < max(shares) < 0.4
    assert max(shares[1024 // 50 :]) < RADIANCE


@pytest.mark.parametrize("representation", ["cards", "distant"])
def test_a_light_that_comes_from_black_has_its_own_colour_and_shape(representation, tmp_path):
    tracks = moving(FRAMES, 2)
    tracks.lobes.sharpness[1] *= 7  # black there, in another shape
    tracks.lobes.amplitude[1] = 0
    stage = written(tracks, tmp_path, representation)
    back = read_usd(tmp_path / "shot.usda")
    own, read = (one.lobes.sharpness[1].sort().values for one in (tracks, back))
    np.testing.assert_allclose(read, own, rtol=1e-5)
    wanted = motion.at(tracks, TIMES)
    for index, name in enumerate(tracks.names):
        prim = stage.GetPrimAtPath(f"/AsgRig/Lobes/{name}")
        for place, time in enumerate(TIMES):
            true = wanted[place].select(torch.tensor([index]))
            assert radiance_error(lobe_of(prim, time, true.form), true) < RADIANCE
            for light in (one for one in Usd.PrimRange(prim) if one.GetAttribute(schema.COLOR)):
                color = number(light, schema.COLOR, time)
                tint = true.amplitude[0].numpy() / true.amplitude.max().item()
                np.testing.assert_allclose(color, tint, atol=0.05)


def test_a_broad_lobe_that_turns_into_a_band_takes_few_samples() -> None:
    """Its outer card is the widest that there is on one way; samples are finite and no closer."""
    sharpness = [[[15.15, 2.43]], [[0.0903, 1.36]]]
    axes, light = torch.eye(3).expand(2, 1, 3, 3), torch.ones(2, 1, 3)
    lobes = continuous(Lobes(axes, torch.tensor(sharpness), light))
    (track,) = Shot(lobes, np.array([1.0, 2.0])).of_cards([cards.Kind.SOFT])
    # log sharpness goes 5.1 in 40 steps of 0.13: half of its square is less than is allowed
    assert len(track.times) < 40


def test_the_samples_between_are_no_frames(tmp_path) -> None:
    report = write_usd(CASES["noisy"], tmp_path / "shot.usdc")
    assert report.samples_between > 0
    assert samples_between(tmp_path / "shot.usdc") == report.samples_between
    assert read_usd(tmp_path / "shot.usdc").frames == tuple(FRAMES)


def test_frames_that_are_further_apart_have_samples_between_at_whole_numbers_too(tmp_path) -> None:
    tracks = replace(CASES["noisy"], frames=(10, 20, 30))
    write_usd(tracks, tmp_path / "shot.usda")
    times = [12.0, 15.0, 27.5]
    found, wanted = read_between(tmp_path / "shot.usda", times), motion.at(tracks, times)
    ratio = asg.flux(found).sum(-1) / asg.flux(wanted).sum(-1)
    assert float((ratio - 1).abs().max()) < FLUX
    assert read_usd(tmp_path / "shot.usda").frames == (10, 20, 30)
