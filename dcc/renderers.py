# SPDX-License-Identifier: Apache-2.0
"""Running the renderers in their own interpreter, `.venv-dcc`."""

import json
import subprocess
from pathlib import Path
from typing import Any

from asglight.errors import InputError

ROOT = Path(__file__).resolve().parents[1]
PYTHON = ROOT / ".venv-dcc" / "bin" / "python"


def run(module: str, jobs: list[dict[str, Any]], folder: Path, python: Path = PYTHON) -> None:
    """Do jobs in a renderer; it reports on standard error as it goes.

    Args:
        module: `dcc.blender_render` or `dcc.mitsuba_render`.
        jobs: What to do, see there.
        folder: For the list of jobs and what the renderer prints.
        python: An interpreter that has the renderer.

    Raises:
        InputError: There is no such interpreter.
        RuntimeError: The renderer failed.
    """
    if not python.is_file():
        raise InputError(
            f"{python}: no such interpreter; expected one with bpy and mitsuba. "
            "Run `make setup-dcc` first."
        )
    name = module.rpartition(".")[2]
    listed, log = folder / f"{name}.json", folder / f"{name}.log"
    listed.write_text(json.dumps(jobs, indent=1))
    with log.open("w") as printed:
        command = [str(python), "-m", module, str(listed.resolve())]
        result = subprocess.run(command, cwd=ROOT, stdout=printed)
    if result.returncode or not all(Path(job["out"]).is_file() for job in jobs):
        raise RuntimeError(f"{module} failed with status {result.returncode}; see {log}")
