# SPDX-License-Identifier: Apache-2.0
"""Stages of every kind that asglight writes, for `.ci/usd-versions` to open elsewhere.

    python -m benchmarks.stages.writing FOLDER

Every preset's fit of two frames of the built-in environment, every form, format and representation,
and every option of a stage; each is checked by the own lint and by USD's validators first.
"""

import sys
from dataclasses import replace
from pathlib import Path

from pxr import Usd, UsdValidation

from asglight.cli.sources.built_in import environment
from asglight.fitting.options import FitOptions, Preset
from asglight.images import write_exr
from asglight.lobes import Form
from asglight.shots import fit_shot
from asglight.usd import StageOptions, lint_stage, write_edit_layer, write_usd
from asglight.usd.options import OF_LOBES
from asglight.usd.read.read_options import read_options
from asglight.usd.read.tracks import read_usd
from asglight.usd.stage import held_representations, show

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests" / "support"))
from usd_tracks import moving, of_every_kind

FRAMES = (1001, 1002, 1005)
EVERYTHING = StageOptions(
    *(("distant", "cards", "dome"), 50.0, 8, 0.01, "Z", "/World/Lights/Env", "ACEScg"),
    distant_lights=3,
    card_texture=True,
)


def main() -> None:
    """Write the stages and check them."""
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True)
    for preset in Preset:
        fitted(folder, preset)
    for form in Form:
        for representation in OF_LOBES:
            path = folder / f"{form}-{representation}.usda"
            alone = (str(representation),)
            write_usd(moving(FRAMES, form=form), path, representations=alone, dome_height=8)
        tracks = of_every_kind(FRAMES, form)
        write_usd(tracks, folder / f"{form}-texture.usda", dome_height=8, card_texture=True)
    for suffix in ("usda", "usdc", "usd", "usdz"):
        tracks = of_every_kind(FRAMES)
        write_usd(tracks, folder / f"everything-{suffix}.{suffix}", **vars(EVERYTHING))
    tracks = read_usd(folder / "everything-usdc.usdc")
    lobes = tracks.lobes.clone()
    lobes.amplitude[:, 0] *= 2
    target = folder / "edits.usda"
    write_edit_layer(target, folder / "everything-usdc.usdc", replace(tracks, lobes=lobes), [0])
    stages = sorted(folder.glob("*.usd*"))
    findings = [finding for stage in stages for finding in checked(stage)]
    print(f"UsdValidation and lint: {len(stages)} stages, {len(findings)} findings")
    sys.exit("\n".join(findings) or 0)


def fitted(folder: Path, preset: Preset) -> None:
    """Fit two frames of the built-in environment."""
    images = folder / "images"
    images.mkdir(exist_ok=True)
    for frame in (1001, 1002):
        write_exr(images / f"sky.{frame}.exr", environment(frame))
    options = FitOptions(lobes=4, preset=preset, paper_steps=(20, 10))
    fit_shot(images, folder / f"{preset}.usdc", options)


def checked(path: Path) -> list[str]:
    """Return what USD's validators and the own lint find in every representation."""
    found = lint_stage(path)
    primary = read_options(path).primary_path
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    stage = Usd.Stage.Open(str(path))
    stage.SetEditTarget(stage.GetSessionLayer())
    rig = stage.GetPrimAtPath(primary)
    for representation in held_representations(rig):
        show(rig, representation)
        errors = UsdValidation.ValidationContext(validators).Validate(stage)
        found += [error.GetErrorAsString() for error in errors]
    return [f"{path.name}: {text}" for text in found]


if __name__ == "__main__":
    main()
