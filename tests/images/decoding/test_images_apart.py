# SPDX-License-Identifier: Apache-2.0
"""Images are decoded in another process, which no file can take the fit down with."""

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import image_files
import numpy as np
import pytest
import torch
from full_disk import full_beyond
from places import ROOT
from processes import is_running, wait_until

from asglight.errors import InputError
from asglight.images import open_sequence, read_latlong
from asglight.images.decoding import apart, copies
from asglight.images.decoding.apart import Apart, ApartError
from asglight.images.decoding.decode import read_header
from asglight.images.decoding.decoders import APART, Elsewhere
from asglight.images.decoding.header import DamagedError, from_json, to_json
from asglight.images.options import ReadOptions

ELSEWHERE = Elsewhere()


def pid_of(decoder: Elsewhere) -> int:
    """Return the process that waits; there is one."""
    (process,) = decoder._idle
    return process._process.pid


def idle_decoder(path: Path) -> Elsewhere:
    """Return a decoder whose one process waits."""
    decoder = Elsewhere()
    decoder.header(path, ReadOptions())
    return decoder


@pytest.mark.parametrize("height", [4, 256, 257, 700])
def test_pixels_are_those_that_are_decoded_here(tmp_path: Path, height: int) -> None:
    # 700 rows are three strips, so that each of the two slots is used again
    values = np.random.default_rng(1).random((height, 2 * height, 3)).astype(np.float16)
    path = image_files.write_rgb(tmp_path / "a.exr", values)
    elsewhere = read_latlong(path, decoder=ELSEWHERE)
    assert torch.equal(elsewhere.radiance, torch.from_numpy(values.astype(np.float32)))
    assert elsewhere.source_shape == (height, 2 * height)


def test_a_header_survives_the_way_there_and_back(tmp_path: Path) -> None:
    stated = (0.7, 0.3, 0.2, 0.7, 0.1, 0.05, 0.31, 0.33)
    header = read_header(image_files.write_rgb(tmp_path / "a.exr", image_files.ramp()))
    other = image_files.write_rgb(tmp_path / "b.exr", image_files.ramp(), chromaticities=stated)
    for one in (header, read_header(other)):
        assert from_json(to_json(one)) == one


def test_a_relative_path_is_read_in_the_folder_of_the_moment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, value in (("one", 1), ("two", 2)):
        (tmp_path / name).mkdir()
        image_files.constant(tmp_path / name / "a.exr", value)
        monkeypatch.chdir(tmp_path / name)
        assert float(read_latlong("a.exr", decoder=ELSEWHERE).radiance.mean()) == value


def test_a_refusal_says_the_same_and_leaves_the_process_alive(tmp_path: Path) -> None:
    decoder = idle_decoder(image_files.constant(tmp_path / "good.exr", 1))
    before = pid_of(decoder)
    (tmp_path / "text.exr").write_text("no image")
    whole = image_files.constant(tmp_path / "cut.exr", 1, height=64).read_bytes()
    (tmp_path / "cut.exr").write_bytes(whole[:-1000])
    image_files.write(tmp_path / "depth.exr", {"Z": image_files.ramp()[..., 0]})
    for name, kind in (("text", DamagedError), ("cut", DamagedError), ("depth", InputError)):
        messages = []
        for where in ({}, {"decoder": decoder}):
            with pytest.raises(kind) as caught:
                read_latlong(tmp_path / f"{name}.exr", **where)
            messages.append(str(caught.value))
        assert messages[0] == messages[1]
        assert type(caught.value) is kind
    assert pid_of(decoder) == before


def test_a_process_that_dies_is_named_with_the_file_and_replaced(tmp_path: Path) -> None:
    path = image_files.constant(tmp_path / "a.exr", 1)
    decoder = idle_decoder(path)
    before = pid_of(decoder)
    os.kill(before, signal.SIGSEGV)
    with pytest.raises(DamagedError, match=r"a\.exr: cannot be decoded \(its reader was stopped"):
        read_latlong(path, decoder=decoder)
    assert float(read_latlong(path, decoder=decoder).radiance.mean()) == 1
    assert pid_of(decoder) != before


def test_a_process_that_hangs_is_ended_and_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = image_files.constant(tmp_path / "a.exr", 1)
    decoder = idle_decoder(path)
    os.kill(pid_of(decoder), signal.SIGSTOP)
    monkeypatch.setattr(apart, "TIME_LIMIT", 0.2)
    begin = time.monotonic()
    with pytest.raises(DamagedError, match=r"a\.exr: cannot be decoded \(no progress in 0\.2 s\)"):
        read_latlong(path, decoder=decoder)
    assert time.monotonic() - begin < 30


def test_a_file_that_takes_too_much_memory_is_refused(tmp_path: Path) -> None:
    process = Apart("greedy_process")
    process.tell({})
    reply = process.reply()
    process.close()
    # 3 GB are beyond the 256 MB that it allows itself; 100 MB are not
    assert reply == {"got": [True, False]}


def test_what_a_library_prints_reaches_nobody(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    process = Apart("greedy_process")
    process.tell({"print": "a note\n"})
    assert process.reply() == {"printed": True}
    process.close()
    assert capfd.readouterr() == ("", "")


def test_a_bug_comes_back_with_its_traceback() -> None:
    process = Apart("greedy_process")
    process.tell({"print": 3})
    with pytest.raises(RuntimeError, match=r"(?s)greedy_process.*AttributeError"):
        process.reply()
    process.close()


def test_a_module_that_does_not_start_is_said() -> None:
    process = Apart("no_such_module")
    with pytest.raises(ApartError, match="its reader stopped"):
        process.reply()


def test_the_process_ends_when_its_owner_is_killed(tmp_path: Path) -> None:
    path = image_files.constant(tmp_path / "a.exr", 1)
    code = (
        "import sys, os, signal\nfrom pathlib import Path\n"
        "from asglight.images.decoding.decoders import APART\n"
        "from asglight.images.options import ReadOptions\n"
        f"APART.header(Path({str(path)!r}), ReadOptions())\n"
        "print(APART._idle[0]._process.pid, flush=True)\nos.kill(os.getpid(), signal.SIGKILL)"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert result.returncode == -signal.SIGKILL
    pid = int(result.stdout)
    wait_until(lambda: not is_running(pid))
    assert not is_running(pid)


def with_subsampled_chroma(path: Path) -> Path:
    whole, half = np.ones((4, 8), np.float32), np.zeros((2, 4), np.float32)
    planes = {"Y": (whole, 1), "RY": (half, 2), "BY": (half, 2)}
    return image_files.raw_exr(path.with_suffix(".exr"), planes, (8, 4))


def with_another_spelling(path: Path) -> Path:
    pixels, _ = image_files.rgbe()
    plain = image_files.hdr_bytes(pixels, size="-Y 4 +X 8")
    path = path.with_suffix(".hdr")
    path.write_bytes(plain.replace(b"FORMAT=", b"FORMAT= ", 1))
    return path


@pytest.mark.parametrize("write", [with_subsampled_chroma, with_another_spelling])
@pytest.mark.parametrize("is_killed", [True, False])
def test_a_copy_is_gone_however_the_process_ends(
    tmp_path: Path, write: Callable[[Path], Path], is_killed: bool
) -> None:
    path = write(tmp_path / "image")
    (tmp_path / "temporary").mkdir()
    end = "os.kill(os.getpid(), signal.SIGKILL)" if is_killed else "print(place != path)"
    code = (
        "import os, signal\nfrom pathlib import Path\n"
        "from asglight.images.decoding import decode\n"
        f"path = Path({str(path)!r})\n"
        "with decode._readable(path, decode._kind(path)) as place:\n"
        "    assert place.stat().st_size > 0\n"
        f"    {end}"
    )
    environment = {**os.environ, "TMPDIR": str(tmp_path / "temporary")}
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=environment
    )
    ended = (-signal.SIGKILL, "") if is_killed else (0, "True\n")
    assert (result.returncode, result.stdout) == ended, result.stderr
    assert list((tmp_path / "temporary").iterdir()) == []


@pytest.mark.parametrize("write", [with_subsampled_chroma, with_another_spelling])
def test_a_system_that_names_its_copies_reads_the_same(
    tmp_path: Path, write: Callable[[Path], Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write(tmp_path / "image")
    nameless = read_latlong(path).radiance
    monkeypatch.setattr(copies, "OPEN_FILES", tmp_path / "absent")
    assert torch.equal(read_latlong(path).radiance, nameless)


def test_a_user_script_needs_no_main_guard(tmp_path: Path) -> None:
    image_files.constant(tmp_path / "a.exr", 2)
    script = tmp_path / "script.py"
    script.write_text(
        "from asglight.images import open_sequence\n"
        "print(float(open_sequence('a.exr').read(1).radiance.mean()))\n"
    )
    root = ROOT
    result = subprocess.run(
        [sys.executable, script],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(root)},
    )
    assert (result.stdout, result.stderr) == ("2.0\n", "")


def test_threads_have_a_process_each(tmp_path: Path) -> None:
    path = image_files.constant(tmp_path / "a.exr", 1)
    decoder, both = Elsewhere(), threading.Barrier(2)
    header = read_header(path)

    def work() -> None:
        with decoder._lent(header.path):
            both.wait(60)

    threads = [threading.Thread(target=work) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60)
    assert len(decoder._idle) == 2
    decoder.close()
    assert decoder._idle == []


def test_memory_that_cannot_be_had_is_one_line(tmp_path: Path) -> None:
    APART.close()  # a process that has read has memory
    sequence = open_sequence(image_files.constant(tmp_path / "a.exr", 1))
    message = r"^memory: 768 bytes for rows of an image cannot be had \(File.*$"
    with pytest.raises(InputError, match=message), full_beyond(100):
        sequence.read(1)


def damaged_sequence(folder: Path, damaged: dict[int, bytes], **options: str) -> object:
    for frame in range(1, 6):
        path = image_files.constant(folder / f"a.{frame}.exr", frame)
        if frame in damaged:
            path.write_bytes(damaged[frame])
    return open_sequence(folder, **options)


def test_a_damaged_frame_is_filled_as_a_missing_one_is(tmp_path: Path) -> None:
    sequence = damaged_sequence(tmp_path, {3: b"", 4: b"text"}, missing="interpolate")
    image = sequence.read_or_fill(3)
    # 3 lies a third of the way from 2 to 5, which are the nearest that can be read
    assert float(image.radiance.mean()) == pytest.approx(3, rel=1e-6)
    assert image.repair.filled_from == (2, 5)
    assert image.repair.sentence() == "frame is empty, interpolated between 2 and 5"
    assert sequence.read_or_fill(4).repair.sentence() == (
        "frame is text, interpolated between 2 and 5"
    )
    with pytest.raises(DamagedError, match=r"a\.3\.exr: is empty"):
        sequence.read(3)  # the truth is never made up


def test_a_damaged_first_frame_is_held_from_the_next(tmp_path: Path) -> None:
    sequence = damaged_sequence(tmp_path, {1: b"", 2: b""}, missing="hold")
    assert float(sequence.read_or_fill(1).radiance.mean()) == 3
    assert sequence.read_or_fill(1).repair.filled_from == (3,)


def test_a_damaged_frame_is_refused_unless_it_may_be_filled(tmp_path: Path) -> None:
    sequence = damaged_sequence(tmp_path, {3: b""})
    with pytest.raises(DamagedError, match=r"a\.3\.exr: is empty"):
        sequence.read_or_fill(3)


def test_a_sequence_of_damaged_frames_is_refused(tmp_path: Path) -> None:
    sequence = damaged_sequence(tmp_path, dict.fromkeys(range(1, 6), b""), missing="hold")
    with pytest.raises(DamagedError, match=r"a\.\d\.exr: is empty"):
        sequence.read_or_fill(3)


def test_sequences_are_read_apart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []
    header = APART.header
    monkeypatch.setattr(
        APART, "header", lambda path, reading: asked.append(path) or header(path, reading)
    )
    damaged_sequence(tmp_path, {}).read(2)
    assert {path.name for path in asked} == {"a.1.exr", "a.2.exr"}


@pytest.mark.parametrize(
    "module", ["asglight.images.decoding.decoding_process", "asglight.usd.check.probing_process"]
)
def test_a_process_apart_loads_no_torch(module: str) -> None:
    code = f"import {module}, sys; print('torch' in sys.modules)"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (result.stdout, result.stderr) == ("False\n", "")
