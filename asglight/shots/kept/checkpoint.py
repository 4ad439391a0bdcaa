# SPDX-License-Identifier: Apache-2.0
"""The checkpoint of a shot: a file beside the output that grows by one line a frame.

`shot.usda.checkpoint` holds a header (format, version, settings, source, frames) and then one line
for each finished frame (records.py), every line forced to disk before the next frame begins. A run
that is killed leaves at worst one line cut off, which the next run drops. Anything else that does
not fit is refused: a checkpoint is either continued exactly or not at all.

The open file is locked (flock), so a second run on the same output is refused, and so is any other
command that would write it (`alone`); the system gives the lock back however the first run ends.
The file is touched only when the first frame of a run is ready, so a run that fails before leaves
an older checkpoint as it was.
"""

import contextlib
import errno
import fcntl
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO, Self

from asglight.errors import InputError
from asglight.images.frame_files import ranges
from asglight.images.message import shown
from asglight.shots.kept.records import FrameRecord, from_json, line_from, parse_line, to_json

FORMAT = "asglight checkpoint"
FORMAT_VERSION = 4
SUFFIX = ".checkpoint"

_FIRST_BYTES = b'{"record":{"format":"asglight checkpoint"'


def header_of(settings: dict[str, Any]) -> dict[str, Any]:
    """Return the header for a run with these settings (JSON values, by name)."""
    return {"format": FORMAT, "format_version": FORMAT_VERSION, **settings}


class BusyError(InputError):
    """Another run holds the file."""


class Checkpoint:
    """An open, locked checkpoint.

    Attributes:
        path: The file.
        records: Frames of earlier runs and of this one, in order.
        left_aside: Frames of an earlier run that this run does not continue.
        is_locked: False where the file system has no locks.
    """

    def __init__(self, path: Path, header: dict[str, Any], *, resume: bool) -> None:
        """Open and lock the file; read it when it is to be continued.

        Args:
            path: The file; it need not exist.
            header: What the run is, from `header_of`.
            resume: Continue what is there; without it, start afresh.

        Raises:
            InputError: The file cannot be written, another run holds it, it is no checkpoint, it
                is damaged, or it belongs to other settings.
        """
        self.path = path
        self.records: list[FrameRecord] = []
        self.left_aside = 0
        self._header = header
        self._stream, self.is_locked = open_locked(path)
        # Where the next line goes; 0 until this run owns the content.
        self._length = 0
        try:
            self._read(resume)
        except BaseException:
            self._stream.close()
            raise

    def __enter__(self) -> Self:
        """Return the checkpoint."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the file; remove it when nothing was ever written to it."""
        _close(self.path, self._stream)

    def append(self, record: FrameRecord) -> None:
        """Write a frame and wait until it is on disk.

        Raises:
            InputError: The disk is full or fails.
        """
        lines = line_from(to_json(record))
        if self._length == 0:
            lines = line_from(self._header) + lines
        try:
            self._stream.truncate(self._length)
            self._stream.seek(self._length)
            write_all(self._stream, lines)
            os.fsync(self._stream.fileno())
        except OSError as error:
            raise not_writable(self.path, error) from error
        self._length += len(lines)
        self.records.append(record)

    def restart(self) -> None:
        """Forget the frames; the next one replaces those on disk."""
        self.records = []
        self._length = 0

    def remove(self) -> None:
        """Delete the file: the shot is written."""
        _delete(self.path, self._stream)

    def _read(self, resume: bool) -> None:
        content = self._stream.read()
        if not content.startswith(_FIRST_BYTES[: len(content)]):
            raise InputError(
                f"{shown(self.path)}: is no checkpoint of asglight; expected one, or no such file. "
                "Move it away or write to another name."
            )
        lines = content.splitlines(keepends=True)
        parsed = [parse_line(line) for line in lines]
        if parsed and parsed[-1] is None:  # cut off when the run was killed
            del lines[-1], parsed[-1]
        if not resume:
            self.left_aside = max(len(parsed) - 1, 0)
            return
        if parsed:
            self.records = self._frames(parsed)
            self._length = sum(len(line) for line in lines)

    def _frames(self, parsed: list[dict[str, Any] | None]) -> list[FrameRecord]:
        """Return the frames after checking every line."""
        damaged = [number for number, record in enumerate(parsed, 1) if record is None]
        if damaged:
            raise self._damaged(damaged[0])
        header, *rest = [record for record in parsed if record is not None]
        check_same(self.path, header, self._header)
        frames = self._header["frames"]
        records: list[FrameRecord] = []
        for index, record in enumerate(rest):
            try:
                frame = from_json(record)
            except (KeyError, TypeError, ValueError) as error:
                raise self._damaged(index + 2) from error
            if index >= len(frames) or frame.frame != frames[index]:
                raise self._damaged(index + 2)
            records.append(frame)
        return records

    def _damaged(self, line: int) -> InputError:
        return InputError(
            f"{shown(self.path)}: line {line} is damaged; expected an intact checkpoint. "
            "Delete the file or leave out --resume to start afresh."
        )


def check_same(path: Path, found: dict[str, Any], wanted: dict[str, Any]) -> None:
    """Refuse to go on with what another kind of run has made.

    Args:
        path: What was found, for the message.
        found: The settings of that run.
        wanted: Those of this one.

    Raises:
        InputError: They differ.
    """
    for name in dict.fromkeys([*wanted, *found]):
        before, now = found.get(name), wanted.get(name)
        if before != now:
            setting = f"{name.replace('_', ' ')} {_brief(before)}"
            raise InputError(
                f"{shown(path)}: was made with {setting}, this run has {_brief(now)}; "
                "expected the same. Run it as before, or start afresh: delete it or "
                "leave out --resume."
            )


def open_locked(path: Path) -> tuple[BinaryIO, bool]:
    """Open a file for reading and writing, and lock it; tell whether it could be locked.

    Raises:
        BusyError: Another run has locked it.
        InputError: It cannot be written.
    """
    while True:
        try:
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
        except OSError as error:
            raise not_writable(path, error) from error
        stream = os.fdopen(descriptor, "r+b", buffering=0)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            if error.errno not in (errno.EAGAIN, errno.EACCES):
                return stream, False  # a network file system without a lock service
            stream.close()
            raise BusyError(
                f"{shown(str(path).removesuffix(SUFFIX))}: another run is writing it; expected one "
                "run for each output. Wait for it to end or write to another name."
            ) from error
        if _is_still(path, descriptor):
            return stream, True
        stream.close()  # another run has finished and deleted it in between


@contextlib.contextmanager
def alone(output: str | Path) -> Iterator[None]:
    """Keep every fit off an output while something else reads and writes it.

    An older checkpoint stays. Where there is no place for one nothing is locked: nor can the output
    be written there, and who tries says why.

    Args:
        output: The stage.

    Raises:
        BusyError: A fit writes it, or another command.
    """
    path = Path(f"{Path(output)}{SUFFIX}")
    try:
        stream, _ = open_locked(path)
    except BusyError:
        raise
    except (InputError, ValueError):  # the latter of a name with a zero byte
        yield
        return
    try:
        yield
    finally:
        _close(path, stream)


def delete(path: Path) -> None:
    """Delete a file of a run that has ended.

    Raises:
        BusyError: The run goes on.
        InputError: The file cannot be opened.
    """
    if path.exists():
        _delete(path, open_locked(path)[0])


def _close(path: Path, stream: BinaryIO) -> None:
    """Close a checkpoint; remove it where nothing was ever written to it."""
    with contextlib.suppress(OSError):
        if not stream.closed and os.fstat(stream.fileno()).st_size == 0:
            path.unlink()
    stream.close()


def _delete(path: Path, stream: BinaryIO) -> None:
    # Deleted before the lock is given back, so that no other run opens it in between.
    with contextlib.suppress(FileNotFoundError):
        path.unlink()
    stream.close()


def write_all(stream: BinaryIO, data: bytes) -> None:
    """Write every byte: the system may take only some at a time, as on a disk that fills up."""
    rest = memoryview(data)
    while rest:
        rest = rest[stream.write(rest) :]


def _is_still(path: Path, descriptor: int) -> bool:
    try:
        return os.path.samestat(os.stat(path), os.fstat(descriptor))
    except FileNotFoundError:
        return False


def not_writable(path: Path, error: OSError) -> InputError:
    """Return what to raise where a file that is kept cannot be written."""
    return InputError(
        f"{shown(path)}: cannot be written ({error.strerror}); expected a folder with room and the "
        "permission to write. Make room or choose another output; then --resume goes on."
    )


def _brief(value: Any) -> str:
    """Return a setting in a few words."""
    if isinstance(value, list) and all(isinstance(item, int) for item in value) and value:
        return ranges(value)
    return "none" if value is None else shown(str(value))
