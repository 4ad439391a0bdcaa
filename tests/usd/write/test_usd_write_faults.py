# SPDX-License-Identifier: Apache-2.0
"""What cannot be written is refused in one line, and nothing that was there is damaged."""

import itertools
import math
import os
import signal
import sys
import time
from pathlib import Path

import pytest
import torch
from forked import Forks
from full_disk import full_beyond
from usd_tracks import contents, moving, of_every_kind, still, write_every
from written_stages import put_every

from asglight.errors import InputError
from asglight.lobes import Form, Lobes, LobeTracks
from asglight.usd import lint_stage, read_usd, write_usd
from asglight.usd.write import layer


def refused(*arguments, **options) -> str:
    with pytest.raises(InputError) as caught:
        write_every(*arguments, **options)
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("shot.abc", "extension '.abc'; expected .usda, .usdc, .usd or .usdz"),
        ("shot", "extension ''; expected .usda, .usdc, .usd or .usdz"),
        ("no/shot.usda", "no folder"),
        ("a\nb.usda", "control characters in the name"),
    ],
)
def test_a_target_that_cannot_be_is_named(name, message, tmp_path):
    assert message in refused(still(), tmp_path / name)
    assert contents(tmp_path) == {}


@pytest.mark.parametrize(
    ("frames", "message"),
    [
        (
            (1700000000000, 1700000000040),
            "frames: 1700000000000 to 1700000000040; expected numbers",
        ),
        ((-(2**31), 1), "Are they times? Number the images anew."),
        ((0, 1_000_000), "frames: 0 to 1000000; expected fewer than 1,000,000 from the first to"),
    ],
)
def test_frames_that_a_stage_cannot_have_are_named(frames, message, tmp_path):
    assert message in refused(moving(frames), tmp_path / "shot.usda")
    assert contents(tmp_path) == {}


def test_the_largest_frames_are_written_and_read(tmp_path):
    frames = (2**31 - 3, 2**31 - 1)
    write_usd(moving(frames), tmp_path / "shot.usda", representations=("distant",))
    assert read_usd(tmp_path / "shot.usda").frames == frames


def test_files_and_their_folders_are_on_disk_before_the_checkpoint_goes(tmp_path, monkeypatch):
    synced = []
    fsync = os.fsync

    def told(descriptor):
        synced.append(os.readlink(f"/proc/self/fd/{descriptor}"))
        fsync(descriptor)

    if not os.path.isdir("/proc/self/fd"):
        pytest.skip("the system does not tell which file a descriptor is of")
    monkeypatch.setattr(os, "fsync", told)
    report = write_usd(of_every_kind([1, 2]), tmp_path / "shot.usda")
    assert {Path(path).name for path in synced} >= {path.name for path in report.files}
    assert synced[-2:] in (
        [a, b] for a, b in itertools.permutations(map(str, {tmp_path, tmp_path / "shot_dome"}))
    )


def test_a_folder_in_the_place_of_the_stage_is_named(tmp_path):
    (tmp_path / "shot.usda").mkdir()
    assert "shot.usda: is a folder" in refused(still(), tmp_path / "shot.usda")


def test_a_file_in_the_place_of_the_dome_folder_is_named(tmp_path):
    (tmp_path / "shot_dome").write_text("mine")
    message = refused(still(), tmp_path / "shot.usda", dome_height=2)
    assert "shot.usda: cannot be written (File exists); expected a folder with room" in message
    assert contents(tmp_path) == {"shot_dome": b"mine"}


@pytest.mark.parametrize("other", ["shot.usdc", "shot.usd", "shot.USDC"])
def test_images_of_a_stage_with_another_extension_are_left_alone(other, tmp_path):
    tracks = of_every_kind([1, 2])
    write_usd(tracks, tmp_path / other)
    before = contents(tmp_path)
    assert any(name.endswith(".exr") for name in before)
    with pytest.raises(InputError, match=r"shot\.usda: its images would replace those of"):
        write_usd(tracks, tmp_path / "shot.usda")
    assert contents(tmp_path) == before
    write_usd(tracks, tmp_path / "shot.usda", representations=("distant",))  # it has no images
    write_usd(tracks, tmp_path / "shot.usdz")  # it holds its images
    write_usd(tracks, tmp_path / "other.usda")
    (tmp_path / other).unlink()
    write_usd(tracks, tmp_path / "shot.usda")


def test_a_stage_beside_that_shows_no_images_or_is_none_is_in_nobodys_way(tmp_path):
    tracks = of_every_kind([1, 2])
    write_usd(tracks, tmp_path / "shot.usdc", representations=("distant",))
    (tmp_path / "shot.usd").write_bytes(b"PXR-USDC and no more")
    write_usd(tracks, tmp_path / "shot.usda")
    assert lint_stage(write_usd(tracks, tmp_path / "shot.usda").files[0]) == []


@pytest.mark.skipif(not os.path.isdir("/sys"), reason="needs a folder that even root cannot write")
def test_a_folder_without_permission_is_named():
    message = refused(still(), "/sys/shot.usda", dome_height=2)
    assert message.startswith("/sys/shot.usda: cannot be written (")
    assert "expected a folder with room and the permission to write" in message


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"representations": ("sphere",)}, "representations: sphere; expected some of cards, dis"),
        ({"representations": ("dome", "dome")}, "representations: dome,dome; expected some of"),
        ({"representations": ()}, "representations: none; expected some of cards, distant, dome"),
        ({"distance": 0.0}, "distance: 0; expected a finite number above 0"),
        ({"distance": math.inf}, "distance: inf; expected a finite number above 0"),
        ({"meters_per_unit": -1.0}, "meters per unit: -1; expected a finite number above 0"),
        ({"primary_path": "World/Env"}, "primary path: World/Env; expected a prim path such as /W"),
        ({"primary_path": "/"}, "primary path: /; expected a prim path such as"),
        ({"primary_path": ""}, "primary path: empty; expected a prim path such as"),
        ({"primary_path": "/World/a.b"}, "primary path: /World/a.b; expected a prim path"),
        ({"primary_path": "/World//Env/"}, "primary path: /World//Env/; expected a prim path"),
        ({"primary_path": "/World/2nd"}, "primary path: /World/2nd; expected a prim path"),
        ({"colorspace": "sRGB - Display"}, "colorspace: sRGB - Display; expected a linear space"),
        ({"colorspace": ""}, "colorspace: empty; expected a linear space with primaries: Linear R"),
        ({"up_axis": "X"}, "up axis: X; expected one of Y, Z"),
        ({"distant_lights": 2}, "distant lights: 2; expected 1 or 3"),
        ({"dome_height": 1}, "dome height: 1; expected 2 rows or more"),
    ],
)
def test_an_option_out_of_range_is_named(options, message, tmp_path):
    assert message in refused(still(), tmp_path / "shot.usda", **options)
    assert contents(tmp_path) == {}


def changed(name: str, index: tuple[int, ...], value: float) -> LobeTracks:
    tracks = moving(range(1001, 1004))
    getattr(tracks.lobes, name)[index] = value
    return tracks


@pytest.mark.parametrize(
    ("tracks", "message"),
    [
        (changed("amplitude", (1, 2, 0), math.nan), "amplitude of lobe 2 is .*nan.* at frame 1002"),
        (changed("amplitude", (0, 0, 1), -0.5), "amplitude of lobe 0 .*-0.5.* 1001.* from 0 to 1e"),
        (changed("amplitude", (0, 0, 1), math.inf), "amplitude of lobe 0 .*inf.* at frame 1001"),
        (changed("sharpness", (2, 1, 0), 0.0), "sharpness of lobe 1 .* 1003.*from 0.0001 to 1e"),
        (changed("sharpness", (2, 1, 0), math.inf), "sharpness of lobe 1 is .*inf"),
        (changed("sharpness", (2, 1, 0), 1e9), "sharpness of lobe 1 is .*1000000000.0"),
        (changed("amplitude", (0, 0, 1), 3e38), "amplitude of lobe 0 is .*3e.38.* to 1e.37"),
        (changed("axes", (0, 1, 2, 2), 5.0), "axes of lobe 1 .* form a right-handed frame"),
        (changed("axes", (0, 1, 0), math.nan), "axes of lobe 1 .*nan"),
    ],
)
def test_a_lobe_that_cannot_be_a_light_is_named(tracks, message, tmp_path):
    with pytest.raises(InputError, match=f"^tracks: {message}"):
        write_every(tracks, tmp_path / "shot.usda")
    assert contents(tmp_path) == {}


@pytest.mark.parametrize("form", Form)
def test_the_extremes_that_are_allowed_are_written(form, tmp_path):
    tracks = still(((1e-4, 1e-4), (1e8, 1e8)), form)
    tracks.lobes.amplitude[0, 1] = 1e37
    write_every(tracks, tmp_path / "shot.usda", dome_height=128)
    assert read_usd(tmp_path / "shot.usda").lobes.amplitude.max() == torch.tensor(1e37)


def test_a_mirrored_frame_is_named(tmp_path):
    tracks = still()
    tracks.lobes.axes[0, 3, 0] *= -1
    assert "axes of lobe 3 is" in refused(tracks, tmp_path / "shot.usda")


def test_tracks_without_lobes_or_rate_are_named(tmp_path):
    none = Lobes(torch.zeros(1, 0, 3, 3), torch.zeros(1, 0, 2), torch.zeros(1, 0, 3))
    assert "tracks: 0 lobes in 1 frames" in refused(
        LobeTracks((1,), 24.0, none), tmp_path / "a.usd"
    )
    unpaced = LobeTracks((1001,), 0.0, still().lobes)
    assert "fps: 0.0; expected a finite" in refused(unpaced, tmp_path / "a.usd")


@pytest.mark.parametrize("metadata", [{"error": math.nan}, {"folder": Path("a")}])
def test_metadata_that_json_cannot_hold_is_named(metadata, tmp_path):
    tracks = LobeTracks((1001,), 24.0, still().lobes, metadata)
    assert "expected JSON values" in refused(tracks, tmp_path / "shot.usda")


@pytest.mark.skipif(sys.platform == "win32", reason="needs a limit on the size of files")
@pytest.mark.parametrize("extension", ["usda", "usdc"])
@pytest.mark.parametrize(("height", "named"), [(2, "shot."), (64, "shot_dome/shot.0000.exr")])
def test_a_full_disk_leaves_everything_as_it_was(extension, height, named, tmp_path):
    path = tmp_path / f"shot.{extension}"
    put_every(moving(range(10)), path, dome_height=2)
    before = contents(tmp_path)
    with full_beyond(4000):
        message = refused(moving(range(10), seed=1), path, dome_height=height)
    assert message.startswith(f"{tmp_path}/{named}")
    assert "cannot be written" in message
    assert contents(tmp_path) == before


WRITE = """
from usd_tracks import moving
from asglight.usd import write_usd
write_usd(moving(range(5), seed=1), {path!r}, representations=("dome",), dome_height=512)
"""


def test_a_write_that_is_killed_leaves_the_old_stage(tmp_path, tmp_path_factory):
    path = tmp_path / "shot.usdc"
    tracks = moving(range(5))
    write_every(tracks, path, dome_height=2)
    before = contents(tmp_path)
    forks = Forks(tmp_path_factory.mktemp("said"))
    number = forks.begin(hook=WRITE.format(path=str(path)))
    deadline = time.monotonic() + 60
    while not list(tmp_path.glob(".asglight-*/shot_dome/shot.0002.exr")):
        assert time.monotonic() < deadline
        time.sleep(0.01)
    os.kill(number, signal.SIGKILL)
    assert forks.end().returncode == -signal.SIGKILL
    after = contents(tmp_path)
    assert {name: after[name] for name in before} == before
    assert lint_stage(path) == []
    assert read_usd(path).frames == tracks.frames


def test_a_second_write_replaces_the_first(tmp_path):
    path = tmp_path / "shot.usda"
    for tracks in (moving(range(4)), moving(range(2), seed=3)):
        write_usd(tracks, path, representations=("distant", "dome"), dome_height=2)
    assert read_usd(path).frames == (0, 1)
    assert not list(tmp_path.glob(".asglight-*"))


@pytest.mark.parametrize(
    ("bad", "said"),
    [
        (float("nan"), r"asg:sharpness: is \[50\. nan\]; expected finite numbers"),
        (-1.0, r"asg:sharpness: is \[50\. -1\.\]; expected 0 to inf"),
    ],
)
def test_numbers_that_no_light_can_have_are_told_by_name_and_not_written(
    bad, said, tmp_path, monkeypatch
):
    """Such numbers are a bug of whoever derives them; here the bug is made."""

    def broken(one):
        tracks = lobe_tracks(one)
        times = tracks["asg:sharpness"][1]
        tracks["asg:sharpness"] = torch.tensor([[50.0, bad]]).expand(len(times), 2), times
        return tracks

    lobe_tracks = layer.lobe_tracks
    monkeypatch.setattr(layer, "lobe_tracks", broken)
    path = tmp_path / "shot.usda"
    with pytest.raises(RuntimeError, match=f"/AsgRig/Lobes/lobe_00.{said}"):
        write_usd(moving(range(3)), path, representations=("distant", "dome"), dome_height=2)
    assert contents(tmp_path) == {}
