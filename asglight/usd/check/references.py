# SPDX-License-Identifier: Apache-2.0
"""What is checked of a stage from outside before USD composes it.

USD opens whatever a layer names: any path of this computer, and of any other that a path leads to.
So the layers are looked at one by one, each without those it refers to, and those are opened only
where they lie in the stage's own folder or below it, or in its package; `--follow-references` opens
the others too (trust.py).

Binary layers are first opened in another process (probing_process.py): USD 26.11 takes all memory
at about one of a hundred of those that have a few wrong bytes (docs/results/soak.md).
"""

import atexit
import os
import threading
from pathlib import Path

from pxr import Ar, Sdf

from asglight.errors import InputError
from asglight.images.decoding.apart import Apart, ApartError
from asglight.images.message import shown
from asglight.usd.check.layer_facts import LayerFacts, facts_of
from asglight.usd.check.trust import follows_references, is_our_own

_BINARY = (b"PXR-USDC", b"PK\x03\x04")
"""How a crate begins, and a package, which may hold one."""


class UnreadableError(Exception):
    """USD cannot read a layer; the message says why, as a clause."""


def checked_layers(path: Path) -> list[Sdf.Layer]:
    """Look at the layers of a stage, and open those that are text.

    Returns:
        The text layers; while they are kept, USD does not read them anew.

    Raises:
        InputError: The stage refers to layers outside its folder, or to what is no file.
        UnreadableError: A binary layer cannot be read.
        Tf.ErrorException: A text layer cannot be read.
    """
    if is_our_own():
        return []
    kept: list[Sdf.Layer] = []
    seen: set[str] = set()
    waiting = [str(path)]
    while waiting:
        name = waiting.pop()
        if name in seen:
            continue
        seen.add(name)
        facts = _facts(name, kept)
        if facts.clips is not None and not follows_references():
            raise _outside(path, f"has value clips at {facts.clips}")
        for said, target in facts.layers:
            _check_place(path, said, target)
            if os.path.exists(Ar.SplitPackageRelativePathOuter(target)[0]):
                waiting.append(target)
    return kept


def _facts(name: str, kept: list[Sdf.Layer]) -> LayerFacts:
    """Return what a layer refers to, and keep it if it is text."""
    file = Ar.SplitPackageRelativePathOuter(name)[0]
    with open(file, "rb") as stream:
        is_binary = stream.read(8).startswith(_BINARY)
    if is_binary:
        return _PROBE.facts(name, os.stat(file))
    layer = Sdf.Layer.FindOrOpen(name)
    if layer is None:
        raise UnreadableError("of no known kind")
    if not layer.dirty:
        layer.Reload()  # somebody may have kept it since before it was written
    kept.append(layer)
    return facts_of(layer)


def _check_place(path: Path, said: str, target: str) -> None:
    """Refuse a layer that is not a file in or below the stage's folder."""
    file = Ar.SplitPackageRelativePathOuter(target)[0]
    if os.path.exists(file) and not os.path.isfile(file):
        raise InputError(
            f"{shown(path)}: refers to {shown(said)}, which is no file; expected a USD layer. "
            "Correct the reference."
        )
    if not may_open(path, target):
        raise _outside(path, f"refers to {shown(said)}, outside its folder")


def may_open(stage: Path, target: str) -> bool:
    """Tell whether a file that a stage refers to may be opened unasked.

    Args:
        stage: The stage.
        target: The file's path as USD resolves it; of one in a package, that of the package counts.
    """
    if is_our_own() or follows_references():
        return True
    folder = os.path.realpath(stage.parent)
    file = Ar.SplitPackageRelativePathOuter(target)[0]
    return os.path.realpath(file).startswith(os.path.join(folder, ""))


def _outside(path: Path, found: str) -> InputError:
    return InputError(
        f"{shown(path)}: {found}; expected layers beside or below it. If you know where it comes "
        "from, add --follow-references."
    )


class _Probe:
    """The process that tries out binary layers, started when the first one is met."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._known: dict[tuple[str, int, int, int], LayerFacts] = {}
        self._process: Apart | None = None
        self._owner = 0
        atexit.register(self._close)

    def facts(self, name: str, file: os.stat_result) -> LayerFacts:
        """Return what a layer refers to.

        Args:
            name: Its path.
            file: Of its file, as it is now: one that was tried out is not tried out again.

        Raises:
            UnreadableError: It cannot be read, or ends or occupies the process.
        """
        state = (os.path.abspath(name), file.st_ino, file.st_mtime_ns, file.st_size)
        with self._lock:
            if state in self._known:
                return self._known[state]
            if self._process is None or self._owner != os.getpid():
                self._process = Apart("asglight.usd.check.probing_process")
                self._owner = os.getpid()
            try:
                self._process.tell({"layer": name, "bytes": file.st_size, "folder": os.getcwd()})
                answer = self._process.reply()
            except ApartError as error:
                self._process = None
                raise UnreadableError(str(error)) from error
            if "unreadable" in answer:
                raise UnreadableError(answer["unreadable"])
            known = LayerFacts(tuple(map(tuple, answer["layers"])), answer["clips"])
            self._known[state] = known
        return known

    def _close(self) -> None:
        if self._process is not None and self._owner == os.getpid():
            self._process.close()


_PROBE = _Probe()
