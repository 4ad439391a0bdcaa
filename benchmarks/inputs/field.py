# SPDX-License-Identifier: Apache-2.0
"""Inputs as they come from the field: what is right, and what asglight makes of each.

    python -m benchmarks.inputs.field --field ../shared/field -o field.md

One row a case. What is right comes from a closed form, or from the package OpenEXR and a Radiance
decoder of our own (Ward 1991), never from asglight. What is seen is what the command line does: a
fit keeps the flux of its image, so light is compared as the flux of the stage's lobes, channel by
channel. It ends with 1 if a case is wrong.
"""

import argparse
import contextlib
import io
import json
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import OpenEXR

import asglight
from asglight.cli.folders import write_text
from asglight.cli.main import main as asglight_main
from asglight.lobes import asg

FLUX_ERROR = 0.005
"""A fit keeps flux within 0.01 %; XYZE and RGBE round to 8 bits, which makes 0.4 % at most."""


@dataclass(frozen=True)
class Row:
    """One case: what is right and what was seen, in words, and whether they agree."""

    case: str
    right: str
    seen: str
    is_right: bool


def command(*words: object) -> tuple[int, str, str]:
    """Run a command; return its exit status, standard output and standard error."""
    output, errors = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(output), contextlib.redirect_stderr(errors):
        status = asglight_main([str(word) for word in words])
    return status, output.getvalue(), errors.getvalue()


def exr(path: Path) -> np.ndarray:
    """Read R, G, B of the first part with the package OpenEXR.  [H, W, 3]."""
    return OpenEXR.File(str(path)).parts[0].channels["RGB"].pixels.astype(np.float64)


def rgbe(path: Path) -> np.ndarray:
    """Read a Radiance file of flat or run-length coded rows, old or new.  [H, W, 3]."""
    head, _, rest = path.read_bytes().partition(b"-Y ")
    size, _, body = rest.partition(b"\n")
    height, width = int(size.split()[0]), int(size.split()[2])
    pixels, place = [], 0
    while len(pixels) < height * width:
        entry = body[place : place + 4]
        if entry[:2] == b"\x02\x02" and width >= 8:
            place, planes = place + 4, []
            for _ in range(4):
                plane = b""
                while len(plane) < width:
                    count = body[place]
                    is_run = count > 128
                    many = count - 128 if is_run else count
                    values = body[place + 1 : place + 2] * many
                    values = values if is_run else body[place + 1 : place + 1 + many]
                    plane, place = plane + values, place + 1 + (1 if is_run else many)
                planes.append(plane)
            pixels += [*zip(*planes, strict=True)]
        elif entry[:3] == b"\x01\x01\x01":
            pixels += [pixels[-1]] * entry[3]
            place += 4
        else:
            pixels.append(tuple(entry))
            place += 4
    coded = np.array(pixels, dtype=np.float64).reshape(height, width, 4)
    values = coded[..., :3] * 2.0 ** (coded[..., 3:] - 136)
    return values @ XYZ_TO_RGB.T if b"xyze" in head else values


XYZ_TO_RGB = np.linalg.inv(
    [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
)
"""IEC 61966-2-1."""


def linear(encoded: np.ndarray) -> np.ndarray:
    """Return linear values of sRGB (IEC 61966-2-1)."""
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def flux_of(image: np.ndarray) -> np.ndarray:
    """Integrate a latlong over the sphere, exact bands.  [3]."""
    height, width = image.shape[:2]
    edges = np.cos(np.pi * np.arange(height + 1) / height)
    return np.einsum("h,hwc->c", (edges[:-1] - edges[1:]) * 2 * np.pi / width, image)


def light(case: str, folder: Path, right: np.ndarray, *words: object, said: str = "") -> Row:
    """Fit images and compare the flux of every frame with what is right; `said` must be told."""
    stage = folder / "out.usda"
    stage.unlink(missing_ok=True)
    status, output, errors = command("fit", *words, "-o", stage, "--preset", "live", "--lobes", 3)
    expected = f"flux {words_of(right)}" + (f", says {said!r}" if said else "")
    if status:
        return Row(case, expected, errors.strip().splitlines()[-1], is_right=False)
    lobes = asglight.read_usd(stage).lobes
    seen = asg.flux(lobes).sum(dim=1).numpy()  # [F, 3]
    worst = seen[np.abs(seen / right - 1).max(axis=1).argmax()]
    is_said = said.lower() in (output + errors).lower()
    told = "" if is_said else " and does not say so"
    return Row(
        case,
        expected,
        f"flux {words_of(worst)}{told}",
        bool(np.abs(worst / right - 1).max() <= FLUX_ERROR) and is_said,
    )


def words_of(flux: np.ndarray) -> str:
    """Return a flux in four digits a channel."""
    return " ".join(f"{value:.4g}" for value in flux)


def refused(case: str, saying: str, *words: object) -> Row:
    """Run what has to end with one line and exit status 2 that says something."""
    status, _, errors = command(*words)
    lines = errors.strip().splitlines()
    last = lines[-1] if lines else "nothing"
    is_right = status == 2 and saying.lower() in last.lower()
    return Row(case, f"exit 2, says {saying!r}", f"exit {status}: {last}", is_right)


def told(case: str, right: str, holds: Callable[[dict], bool], *words: object) -> Row:
    """Run `info` as JSON and look at the document."""
    status, output, errors = command("info", *words, "--json")
    if status:
        return Row(case, right, errors.strip().splitlines()[-1], is_right=False)
    document = json.loads(output)
    lobes = document.get("lobes", [{}])
    place = [lobes[0].get(f"{name}_deg", 0) for name in ("latitude", "longitude")]
    seen = f"{len(lobes)} lobes, sun at {place[0]:.1f}, {place[1]:.1f}"
    return Row(case, right, seen, holds(document))


def images(field: Path, folder: Path) -> Iterator[Row]:
    """Cases of images."""
    plain = exr(field / "header_says_srgb/plain.exr")
    right = flux_of(plain)
    parts = field / "multipart_first_part"
    yield light(
        "multipart_first_part/fishtail", folder, right, parts / "fishtail.exr", said="layer C"
    )
    yield light("multipart_first_part/seq_partorder", folder, right, parts / "seq_partorder")
    header = field / "header_says_srgb"
    for name in ("from_png", "interop_srgb"):
        path = header / f"{name}.exr"
        yield light(f"header_says_srgb/{name}", folder, flux_of(linear(exr(path))), path)
    yield light("header_says_srgb/interop_xyz", folder, right, header / "interop_xyz.exr")
    as_xyz = flux_of((plain @ XYZ_TO_RGB.T).clip(0))  # texel by texel: outside Rec.709 is 0
    given = (header / "plain.exr", "--input-colorspace", "XYZ")
    yield light("header_says_srgb/plain --input-colorspace XYZ", folder, as_xyz, *given)
    given = (header / "from_png.exr", "--input-colorspace", "lin_rec709_scene")
    as_linear = flux_of(exr(header / "from_png.exr"))
    yield light("header_says_srgb/from_png --input-colorspace", folder, as_linear, *given)
    exposed = field / "exposure_line_sequence/autoexposure"
    right_exposed = flux_of(rgbe(exposed / "set.1001.hdr"))
    yield light("exposure_line_sequence", folder, right_exposed, exposed)
    sun = exr(field / "inf_sun/sun_inf.exr")
    right_sun = flux_of(np.where(np.isinf(sun), 65504.0, sun))
    yield light(
        "inf_sun/sun_inf", folder, right_sun, field / "inf_sun/sun_inf.exr", said="infinite"
    )
    for path in sorted((field / "inf_sun/seq_inf").iterdir()):
        frame = exr(path)
        right_frame = flux_of(np.where(np.isinf(frame), 65504.0, frame))
        yield light(f"inf_sun/seq_inf/{path.name}", folder, right_frame, path)
    nan = folder / "nan.exr"
    OpenEXR.File(
        {"type": OpenEXR.scanlineimage}, {"RGB": np.full((32, 64, 3), np.nan, np.float32)}
    ).write(str(nan))
    yield refused("a frame of NaN alone", "NaN", "fit", nan, "-o", folder / "nan.usda")
    for name in ("xyze", "no_format", "trailing_space", "oldrle_runs"):
        path = field / f"radiance_variants/{name}.hdr"
        yield light(f"radiance_variants/{name}", folder, flux_of(rgbe(path)), path)
    for name in ("topbottom", "sidebyside"):
        path = field / f"stereo/stereo_{name}.exr"
        yield refused(f"stereo/{name}", "--eye", "fit", path, "-o", folder / "s.usda")
        whole = exr(path)
        halves = (whole[:64], whole[64:]) if name == "topbottom" else np.split(whole, 2, axis=1)
        for eye, half in zip(("left", "right"), halves, strict=True):
            yield light(f"stereo/{name} --eye {eye}", folder, flux_of(half), path, "--eye", eye)


def names(field: Path, folder: Path) -> Iterator[Row]:
    """Cases of names and of other files."""
    right = flux_of(exr(field / "header_says_srgb/plain.exr"))
    for pattern in ("seq_at/sky@2x.####.exr", "seq_hash/shot#3.####.exr"):
        given = (field / "pattern_at_hash" / pattern, "--frames", 1)
        yield light(f"pattern_at_hash/{pattern}", folder, right, *given)
    plain = field / "header_says_srgb/plain.exr"
    mixed = folder / "mixed"
    mixed.mkdir()
    for name in ("sky.1001.exr", "sky.1002.EXR", "sky.1003.exr"):
        shutil.copy(plain, mixed / name)
    stage = folder / "mixed.usda"
    status, _, errors = command(
        "fit", mixed / "sky.####.exr", "-o", stage, "--preset", "live", "--lobes", 2
    )
    seen = list(asglight.read_usd(stage).frames) if status == 0 else errors.strip()
    yield Row("1002.EXR among .exr", "[1001, 1002, 1003]", str(seen), seen == [1001, 1002, 1003])
    yield refused("output with a backslash", "", "fit", plain, "-o", folder / "renders\\shot.usda")
    png = folder / "sky.png"
    from PIL import Image

    encoded = (255 * exr(field / "header_says_srgb/interop_srgb.exr")).round().astype(np.uint8)
    Image.fromarray(encoded).save(png)
    yield refused("a PNG", "--input-colorspace", "fit", png, "-o", folder / "p.usda")
    given = (png, "--input-colorspace", "sRGB")
    right = flux_of(linear(encoded / 255))
    yield light("a PNG, --input-colorspace sRGB", folder, right, *given, said="clipped")


def stages(field: Path) -> Iterator[Row]:
    """Cases of stages."""
    up = field / "zup_reference"

    def at(*angles: float) -> Callable[[dict], bool]:
        """Tell whether the sun is at a latitude and a longitude."""
        names = ("latitude_deg", "longitude_deg")
        return lambda document: all(
            abs(document["lobes"][0][name] - angle) < 0.1
            for name, angle in zip(names, angles, strict=True)
        )

    # The sun is at (0.140, 0.700, 0.700) of the rig. Unturned in a Z-up shot it is there as well,
    # which with +Y up is (0.140, 0.700, -0.700).
    yield told("zup_reference/zup_shot", "sun at 44.4, 11.3", at(44.4, 11.3), up / "zup_shot.usda")
    wrong = up / "zup_uncorrected.usda"
    yield told("zup_reference/zup_uncorrected", "sun at 44.4, 168.7", at(44.4, 168.7), wrong)
    rig = field / "sublayer_no_range"
    frames = list(asglight.read_usd(rig / "rig.usda").frames)
    right = f"frames {frames}"
    path = rig / "sublayer_no_range.usda"
    yield told("sublayer_no_range", right, lambda d: d["frames"] == frames, path)
    path = rig / "payload.usda"
    status, output, errors = command("info", path)
    text = (output + errors).strip()
    is_right = status == 0 or "payload" in text.lower().replace("payload.usda", "")
    yield Row("payload", "read, or the payload is named", text.splitlines()[-1], is_right)
    status, output, errors = command("info", rig / "kelvin.usda")
    text = (output + errors).strip()
    words = ("emperature", "another colour")
    line = next((one for one in text.splitlines() if any(word in one for word in words)), "nothing")
    yield Row("kelvin", "colour temperature counted or named", line, line != "nothing")


def table(rows: list[Row]) -> str:
    """Return the rows as Markdown."""
    lines = ["| case | right | seen | |", "|---|---|---|---|"]
    for row in rows:
        cells = (row.case, row.right, row.seen, "right" if row.is_right else "WRONG")
        lines.append("| " + " | ".join(cell.replace("|", "/") for cell in cells) + " |")
    count = sum(row.is_right for row in rows)
    return "\n".join([*lines, "", f"{count} of {len(rows)} right."])


def main() -> None:
    """Run every case and print the table."""
    parser = argparse.ArgumentParser(description="What is made of inputs from the field.")
    parser.add_argument("--field", type=Path, default=Path("../shared/field"))
    parser.add_argument("-o", "--output", type=Path, help="Markdown file of the table")
    arguments = parser.parse_args()
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        cases = (images(arguments.field, folder), names(arguments.field, folder))
        for case in (*cases, stages(arguments.field)):
            for row in case:
                rows.append(row)
                print(f"{'right' if row.is_right else 'WRONG'}  {row.case}", file=sys.stderr)
        text = table(rows).replace(f"{folder}/", "").replace(f"{arguments.field}/", "")
    print(text)
    if arguments.output:
        write_text(arguments.output, f"{text}\n")
    sys.exit(not all(row.is_right for row in rows))


if __name__ == "__main__":
    main()
