# SPDX-License-Identifier: Apache-2.0
"""The seed corpus of the fuzzer: small sound files of every kind that asglight reads.

    python -m soak.seeds        # writes soak/corpus/ anew

The files are made by asglight's own writers where it has one, and else byte by byte or by OpenEXR.
"""

import sys
from pathlib import Path

import numpy as np
import OpenEXR
import OpenImageIO
import torch

from asglight.export import write_json, write_sg_array
from asglight.export.sg_array import SgLayout
from asglight.fitting.options import FitOptions
from asglight.images import Repair, write_exr
from asglight.images.exr_writer import COMPRESSIONS
from asglight.lobes import Form, Lobes, LobeTracks
from asglight.shots.kept.checkpoint import Checkpoint, header_of
from asglight.shots.kept.records import FrameRecord
from asglight.shots.settings import options_as_json
from asglight.usd import write_usd

CORPUS = Path(__file__).resolve().parent / "corpus"

ROWS = 16
"""Of the images: enough for a chunk of every compression to hold something."""

FRAMES = (1, 2, 3)

CHECKPOINT_HEADER = header_of(
    {"frames": list(FRAMES), "fps": 24.0, "source": "sky", **options_as_json(FitOptions(lobes=2))}
)
"""What the checkpoint was made with, and has to be read with."""


def image() -> np.ndarray:
    """Return a sky with a lamp and some noise.  [ROWS, 2 ROWS, 3] float32."""
    values = np.random.default_rng(1).random((ROWS, 2 * ROWS, 3)).astype(np.float32)
    values[4, 7] = (900.0, 800.0, 700.0)
    return values


def tracks() -> LobeTracks:
    """Return two lobes of which one moves."""
    generator = torch.Generator().manual_seed(3)
    axes = torch.linalg.qr(torch.randn(2, 3, 3, generator=generator)).Q
    axes[..., 2, :] *= torch.linalg.det(axes).sign()[:, None]
    amplitude = 1 + torch.rand(len(FRAMES), 2, 3, generator=generator)
    sharpness = torch.tensor([[4.0, 9.0], [30.0, 20.0]]).expand(len(FRAMES), 2, 2)
    lobes = Lobes(axes.expand(len(FRAMES), 2, 3, 3), sharpness, amplitude, Form.ASG)
    return LobeTracks(FRAMES, 24.0, lobes, {"source": "sky"}, ("lobe_00", "lobe_01"))


def write_corpus(folder: Path) -> None:
    """Write every seed into a folder."""
    folder.mkdir(exist_ok=True)
    _write_images(folder)
    shot = tracks()
    # stages that differ in their extension only would have one folder of images
    for ending in (".usda", "_crate.usdc", ".usdz"):
        for representation in ("distant", "cards"):
            write_usd(
                shot,
                folder / f"{representation}{ending}",
                representations=(representation, "dome"),
                dome_height=2,
            )
    write_json(folder / "tracks.json", shot, shot.names)
    for layout in SgLayout:
        write_sg_array(folder / f"{layout}.npy", shot, layout)
    _write_checkpoint(folder / "shot.checkpoint", shot)


def _write_images(folder: Path) -> None:
    radiance = torch.from_numpy(image())
    for compression in COMPRESSIONS:
        write_exr(folder / f"{compression}.exr", radiance, compression=compression)
    write_exr(folder / "float.exr", radiance, half=False)
    tiles = OpenEXR.TileDescription()
    tiles.xSize = tiles.ySize = 8
    tiled = {"type": OpenEXR.tiledimage, "tiles": tiles}
    OpenEXR.File(tiled, {"RGB": image()}).write(str(folder / "tiled.exr"))
    part = {"type": OpenEXR.scanlineimage, "compression": OpenEXR.ZIP_COMPRESSION}
    parts = [
        OpenEXR.Part(dict(part), {"RGB": image()}, "beauty"),
        OpenEXR.Part(dict(part), {"Z": image()[..., 0].copy()}, "depth"),
    ]
    OpenEXR.File(parts).write(str(folder / "parts.exr"))
    _write_statements(folder)
    mantissa = (255 * np.random.default_rng(2).random((ROWS, 2 * ROWS, 4))).astype(np.uint8)
    mantissa[..., 3] = 128
    size = f"-Y {ROWS} +X {2 * ROWS}"
    (folder / "flat.hdr").write_bytes(hdr_bytes(mantissa, size))
    (folder / "turned.hdr").write_bytes(hdr_bytes(mantissa, f"+X {2 * ROWS} +Y {ROWS}"))
    (folder / "runs.hdr").write_bytes(hdr_bytes(mantissa, size, in_runs=True))
    stated = "EXPOSURE=2\nCOLORCORR=1 1 .5\nGAMMA=2\nVIEW= -vtv -vh 90\n"
    primaries = "PRIMARIES=.64 .33 .29 .6 .15 .06 .333 .333\n"
    lines = (hdr_bytes(mantissa, size).partition(b"FORMAT")[0], f"{stated}{primaries}".encode())
    pixels = f"FORMAT=32-bit_rle_xyze \n\n{size}\n".encode() + mantissa.tobytes()
    (folder / "stated.hdr").write_bytes(b"".join(lines) + pixels)
    runs = np.repeat(mantissa[:, :1], 2, axis=1)
    runs[:, 1] = (1, 1, 1, 2 * ROWS - 1)  # old runs: each row repeats its first pixel
    (folder / "old_runs.hdr").write_bytes(hdr_bytes(runs, size))


def _write_statements(folder: Path) -> None:
    """Write files that state colours, several images, eyes and infinities."""
    scanlines = {"type": OpenEXR.scanlineimage, "compression": OpenEXR.ZIP_COMPRESSION}
    space = {"chromaticities": (0.713, 0.293, 0.165, 0.83, 0.128, 0.044, 0.32168, 0.33767)}
    looks = {"whiteLuminance": 100.0, "adoptedNeutral": np.array([0.3457, 0.3585], np.float32)}
    name = {"colorInteropID": "lin_ap1_scene"}
    stated = {**scanlines, **space, **looks, **name}
    OpenEXR.File(stated, {"RGB": image()}).write(str(folder / "stated.exr"))
    encoded = {**scanlines, "colorInteropID": "srgb_rec709_scene"}
    infinite = (image() / 900).astype(np.float16)
    infinite[4, 6:9] = np.inf
    infinite[9, 3, 1] = np.nan
    OpenEXR.File(encoded, {"RGB": infinite}).write(str(folder / "infinite.exr"))
    OpenEXR.File({**scanlines, "acesImageContainerFlag": 1}, {"RGB": image()}).write(
        str(folder / "aces.exr")
    )
    for names in ("XYZ", ("Y", "RY", "BY")):
        channels = {name: image()[..., index].copy() for index, name in enumerate(names)}
        OpenEXR.File(dict(scanlines), channels).write(str(folder / f"{''.join(names).lower()}.exr"))
    layers = {
        f"{layer}.{channel}": image()[..., index].copy()
        for layer in ("beauty", "right.beauty", "N", "crypto00")
        for index, channel in enumerate("RGB")
    }
    OpenEXR.File({**scanlines, "multiView": ["left", "right"]}, layers).write(
        str(folder / "layers.exr")
    )
    eyes = [
        OpenEXR.Part({**scanlines, "view": view}, {"RGB": image()}, f"rgba.{view}")
        for view in ("left", "right")
    ]
    OpenEXR.File(eyes).write(str(folder / "eyes.exr"))
    OpenImageIO.ImageBuf(image()).write(str(folder / "float.tif"))
    encoded_image = OpenImageIO.ImageBuf(image() / 900)
    encoded_image.set_write_format("uint8")
    for suffix in ("png", "jpg", "webp"):
        assert encoded_image.write(str(folder / f"integers.{suffix}")), encoded_image.geterror()
    height, width = image().shape[:2]
    (folder / "float.pfm").write_bytes(
        f"PF\n{width} {height}\n-1.0\n".encode() + image().astype("<f4").tobytes()
    )


def hdr_bytes(pixels: np.ndarray, size: str, *, in_runs: bool = False) -> bytes:
    """Return a Radiance file, flat or with run-length coded rows.  [H, W, 4] uint8."""
    head = f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=1.0\n\n{size}\n".encode()
    if not in_runs:
        return head + pixels.tobytes()
    body = b""
    for row in pixels:
        body += bytes([2, 2, len(row) >> 8, len(row) & 255])
        body += b"".join(bytes([len(row)]) + row[:, k].tobytes() for k in range(4))
    return head + body


def _write_checkpoint(path: Path, shot: LobeTracks) -> None:
    path.unlink(missing_ok=True)
    with Checkpoint(path, CHECKPOINT_HEADER, resume=False) as checkpoint:
        for place, frame in enumerate(FRAMES):
            checkpoint.append(
                FrameRecord(frame, shot.lobes[place], 0.25, 1e-7, Repair(3, 1), (1234, 5), 0.5)
            )


if __name__ == "__main__":
    write_corpus(CORPUS)
    total = sum(file.stat().st_size for file in CORPUS.rglob("*") if file.is_file())
    print(f"{CORPUS}: {total} bytes", file=sys.stderr)
