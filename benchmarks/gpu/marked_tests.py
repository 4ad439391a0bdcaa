# SPDX-License-Identifier: Apache-2.0
"""The tests that are marked `gpu`."""

import subprocess
import sys
import tempfile
import xml.etree.ElementTree
from collections.abc import Iterator
from pathlib import Path

from benchmarks.gpu.rows import Given, Row

ROOT = Path(__file__).resolve().parents[2]


def measure(given: Given) -> Iterator[Row]:
    """Run them; without a GPU all are left out."""
    files = [path for path in sorted(ROOT.glob("tests/**/*.py")) if is_marked(path)]
    if given.short:
        files = files[:1]
    with tempfile.TemporaryDirectory(prefix="asglight-") as folder:
        told = Path(folder) / "tests.xml"
        words = ["-m", "gpu", "-q", "-p", "no:cacheprovider", f"--junitxml={told}"]
        done = subprocess.run(
            [sys.executable, "-m", "pytest", *words, *map(str, files)],
            cwd=ROOT,
            capture_output=True,
            text=True,
            check=False,
        )
        if not told.is_file():
            raise RuntimeError((done.stdout + done.stderr).strip() or "pytest told nothing")
        cases = list(xml.etree.ElementTree.parse(told).iter("testcase"))
    failed = [case.attrib["name"] for case in cases if _has(case, "failure", "error")]
    left_out = sum(_has(case, "skipped") for case in cases)
    passed = len(cases) - len(failed) - left_out
    found = {"passed": passed, "failed": len(failed), "left out": left_out}
    yield Row(f"{len(cases)} tests marked gpu", {name: float(n) for name, n in found.items()})
    if failed:
        raise RuntimeError(f"failed: {', '.join(failed)}\n{done.stdout[-4000:]}")
    if given.is_gpu and (left_out or not passed):
        raise RuntimeError(f"{left_out} tests were left out, {passed} passed; expected all to run")


def is_marked(path: Path) -> bool:
    """Tell whether a file has tests that need a GPU."""
    return path.name.startswith("test_") and "@pytest.mark.gpu" in path.read_text()


def _has(case: xml.etree.ElementTree.Element, *tags: str) -> bool:
    return any(case.find(tag) is not None for tag in tags)
