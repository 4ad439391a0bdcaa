# SPDX-License-Identifier: Apache-2.0
"""Which files on disk are the frames of a source: a file, a folder or a pattern.

A pattern is written as studios write it and fileseq parses it: `sky.####.exr`, `sky.%04d.exr`,
`sky.@@@@.exr`, `sky.$F4.exr`, or with a range, `sky.1001-1048x2#.exr`. The number of pad
characters is not held against the files, because programs disagree on how many digits a `#` is:
the frame is the number, however it is padded. Of several places that could be the frame's,
as in `sky@2x.####.exr`, the last that files agree with is it. Letters of an extension are the same
in both cases, and those with accents however Unicode composes them.
"""

import difflib
import os
import re
import unicodedata
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from fileseq import framesToFrameRange
from fileseq.exceptions import MaxSizeException
from fileseq.filesequence import FileSequence
from fileseq.frameset import FrameSet

from asglight.errors import InputError
from asglight.images.message import compressed, forward, has_backslash, listing, shown

IMAGE_EXTENSIONS = (".exr", ".hdr", ".pic", ".rgbe")

# `sky.1001.exr` is (`sky.`, 1001, `.exr`). A minus sign belongs to the number only after a dot, an
# underscore or nothing; in `sky-1001.exr` it is a hyphen. A number that runs on into a word, as in
# `hdri_4k.exr`, is no frame. Digits are 0 to 9: those of other scripts, of which no program numbers
# frames, are letters here and in all that follows.
_NAME = re.compile(
    r"(?P<base>.*?)(?P<frame>(?:(?:(?<=[._])|^)-)?[0-9]+)?(?P<extension>(?:\.[^\W0-9]\w*)*)",
    re.DOTALL,
)


_PAD = re.compile(r"(?P<range>-?[0-9][0-9,:x-]*)?(?P<pad>#+|@+|%0?[0-9]*d|\$F[0-9]*)")
"""Where a pattern has its frame: perhaps a range, and one of the ways to write a padded number."""

_SUBFRAME = r"(-?[0-9]+)\.[0-9]+"
"""Between base and extension: `1001.5`."""


class NothingThereError(InputError):
    """No file of a source is there, or not yet."""


@dataclass(frozen=True)
class FrameFiles:
    """The files of one source.

    Attributes:
        folder: Where they lie.
        base: Their name before the frame number.
        extension: Their name after it.
        files: Every file that is there, by frame, in ascending order.
        asked: The frames that the source itself names by a range, None where it names none.
        still: True for a single image rather than a sequence.
    """

    folder: Path
    base: str
    extension: str
    files: dict[int, Path]
    asked: tuple[int, ...] | None = None
    still: bool = False

    @property
    def name(self) -> str:
        """Return a short name: the base without its separator, else the folder's name."""
        return shown(self.base.rstrip("._- ") or self.folder.resolve().name)

    @property
    def pattern(self) -> str:
        """Return the source as a pattern, or the path of a still."""
        if self.still:
            return str(next(iter(self.files.values())))
        frame, first = next(iter(self.files.items()))
        sign = 1 if frame < 0 else 0
        digits = len(first.name) - len(self.base) - sign - len(self.extension)
        return str(self.folder / f"{self.base}{'#' * digits}{self.extension}")


def find(source: str | Path) -> FrameFiles:
    """Find the files of a source.

    Args:
        source: A file, a folder that holds one image or one image sequence, or a pattern.

    Raises:
        InputError: Nothing is there, or more than one thing.
    """
    if not str(source) or "\0" in str(source):
        raise InputError("input: is no path; expected a file, a folder or a pattern.")
    path = Path(source)
    try:
        if path.is_dir():
            return _in_folder(path)
        if path.exists():
            return _still(path)
        return _by_pattern(path)
    except OSError as error:
        raise InputError(
            f"{shown(path)}: cannot be listed ({error.strerror}); expected a readable folder. "
            "Check the path and the permissions."
        ) from error


def find_growing(source: str | Path) -> FrameFiles:
    """Find the files of a folder or pattern that grows: one with a number begins a sequence.

    Raises:
        InputError: As `find`.
    """
    found, folder = find(source), Path(source)
    if not (found.still and folder.is_dir()):
        return found
    (path,) = found.files.values()
    base, frame, extension = _split(path.name)
    if frame is None:
        return found
    return FrameFiles(folder, base, extension, {frame: path})


def is_pattern(source: str | Path) -> bool:
    """Tell whether a source names a place for frame numbers."""
    return _PAD.search(Path(source).name) is not None


def sources_in(folder: Path) -> list[tuple[str, str]]:
    """Return the images and sequences of a folder: a title for each, and what names it to `find`.

    Args:
        folder: The folder.

    Raises:
        OSError: It cannot be listed.
    """
    groups = _groups(folder)
    names = [names[0] if len(names) == 1 else _pattern(names[0]) for names in groups.values()]
    paths = [str(folder / name) for name in names]
    return list(zip(_titles(groups), paths, strict=True))


def sequence_of(path: Path) -> str | None:
    """Return the pattern of the sequence that one image belongs to; None where it is alone.

    Args:
        path: An image: `sky.1001.exr`.
    """
    try:
        groups = _groups(path.parent) if path.is_file() else {}
    except OSError:
        return None
    siblings = next((names for names in groups.values() if path.name in names), [])
    return str(path.parent / _pattern(path.name)) if len(siblings) > 1 else None


def frame_set(text: str, subject: str) -> tuple[int, ...]:
    """Parse frames such as `1001-1048`, `1001-1048x2` or `5,7,9` into ascending numbers.

    Args:
        text: The frames.
        subject: What to call them in a message.

    Raises:
        InputError: Not a list of whole frames, or an empty one.
    """
    try:
        frames = list(FrameSet(text))
    except (ValueError, ArithmeticError) as error:  # the latter of numbers with too many digits
        # fileseq's parser answers in several lines, of which the first names the text only.
        reason = " (too many)" if isinstance(error, MaxSizeException) else ""
        raise _not_frames(text, subject, reason) from error
    if not frames or any(frame != int(frame) for frame in frames):
        raise _not_frames(text, subject, "")
    return tuple(sorted({int(frame) for frame in frames}))


def ranges(frames: tuple[int, ...] | list[int]) -> str:
    """Return frames in short: `1017, 1018, 1040`, or by ranges where there are more than eight."""
    if len(frames) <= 8:
        return ", ".join(str(frame) for frame in frames)
    return listing(framesToFrameRange(frames).split(","))


def _not_frames(text: str, subject: str, reason: str) -> InputError:
    return InputError(
        f"{subject}: {shown(text) or 'nothing'}{reason}; expected whole frames such as "
        "1001-1048, 1001-1048x2 or 5,7,9."
    )


def _split(name: str) -> tuple[str, int | None, str]:
    """Split a file name into what precedes the frame, the frame, and what follows."""
    match = _NAME.fullmatch(name)
    if match is None or match["frame"] is None:
        stem, dot, suffix = name.rpartition(".")
        return (stem, None, dot + suffix) if dot else (name, None, "")
    return match["base"], int(match["frame"]), match["extension"]


def _still(path: Path) -> FrameFiles:
    """Take one file as a still; its frame is its number after a dot, `sky.1001.exr`, else 1.

    Other numbers in a name are as often a version or a size: `v02.exr`, `venice_2048.exr`.
    """
    base, frame, extension = _split(path.name)
    if frame is None or (base and not base.endswith(".")):
        stem = path.name.removesuffix(path.suffix)
        return FrameFiles(path.parent, stem, path.suffix, {1: path}, still=True)
    return FrameFiles(path.parent, base, extension, {frame: path}, still=True)


def _in_folder(folder: Path) -> FrameFiles:
    groups = _groups(folder)
    if not groups:
        others = listing(sorted(entry.name for entry in os.scandir(folder))) or "nothing"
        raise NothingThereError(
            f"{shown(folder)}: holds no image ({others}); expected one .exr or .hdr image or "
            "sequence. Is it in a folder below?"
        )
    if len(groups) > 1:
        _check_groups_whole(folder, groups)
        (base, extension), names = next(iter(groups.items()))
        one = folder / (names[0] if len(names) == 1 else f"{base}####{extension}")
        raise InputError(
            f"{shown(folder)}: holds {len(groups)} images or sequences "
            f"({listing(_titles(groups))}); expected one. Name the one to use, such as "
            f"{shown(one)}."
        )
    ((base, extension), names) = next(iter(groups.items()))
    if len(names) == 1:
        return _still(folder / names[0])
    return FrameFiles(folder, base, extension, _by_frame(folder, names, base, extension))


def _check_groups_whole(folder: Path, groups: dict[tuple[str, str], list[str]]) -> None:
    """Refuse a folder whose images are apart because their frames have fractions.

    Those of `sky.1001.0.exr`, `sky.1001.5.exr`, `sky.1002.0.exr` are two sequences by their names,
    which differ in a number alone, or one beside the sequence of whole frames.
    """
    wholes: dict[str, list[str]] = {}
    for (base, _), names in groups.items():
        if match := re.fullmatch(r"(.*?)-?[0-9]+\.", base, re.DOTALL):
            wholes.setdefault(match[1], []).append(names[0])
    for parent, first in wholes.items():
        if len(first) > 1 or any(base == parent for base, _ in groups):
            raise _subframe(folder, first[0])


def _subframe(folder: Path, name: str) -> InputError:
    return InputError(
        f"{shown(folder)}: {shown(name)} is between two frames; expected whole frames. Keep "
        "subframes in a folder of their own, or number them as frames."
    )


def _groups(folder: Path) -> dict[tuple[str, str], list[str]]:
    """Return the images of a folder by what precedes and follows their frame number."""
    groups: dict[tuple[str, str], list[str]] = {}
    first: dict[tuple[str, str], tuple[str, str]] = {}  # by how names are held against each other
    for name in _file_names(folder):
        # Hidden names are the leftovers of file systems and of interrupted writers.
        if name.startswith(".") or not name.lower().endswith(IMAGE_EXTENSIONS):
            continue
        base, frame, extension = _split(name)
        own = (base, extension) if frame is not None else (name, "")
        if frame is not None:
            own = first.setdefault((_composed(base), extension.lower()), own)
        groups.setdefault(own, []).append(name)
    return groups


def _file_names(folder: Path) -> list[str]:
    """Return the names in a folder but those of folders, in order."""
    return sorted(name for name in os.listdir(folder) if not os.path.isdir(folder / name))


def _composed(name: str) -> str:
    """Return a name with its accents composed: some file systems take them apart."""
    return unicodedata.normalize("NFC", name)


def _titles(groups: dict[tuple[str, str], list[str]], *, with_frames: bool = True) -> list[str]:
    """Name groups as a user would: a still by its file, a sequence by its pattern and frames."""
    titles = []
    for (base, extension), names in groups.items():
        frames = sorted(frame for _, frame, _ in map(_split, names) if frame is not None)
        is_still = len(names) == 1
        span = f" {frames[0]}-{frames[-1]}" if frames and with_frames else ""
        titles.append(names[0] if is_still else f"{base}####{extension}{span}")
    return titles


def _pattern(name: str) -> str:
    """Return the pattern of a file with a frame number."""
    base, _, extension = _split(name)
    return f"{base}####{extension}"


def _by_frame(folder: Path, names: list[str], base: str, extension: str) -> dict[int, Path]:
    """Return those files by frame whose name is the base, a frame number and the extension."""
    sign = "-?" if not base or base[-1] in "._" else ""
    start, end = re.escape(_composed(base)), f"(?i:{re.escape(_composed(extension))})"
    frame_file = re.compile(f"{start}({sign}[0-9]+){end}")
    files: dict[int, Path] = {}
    for name in names:
        match = frame_file.fullmatch(_composed(name))
        if match is None:
            continue
        frame = int(match[1])
        if frame in files:
            raise InputError(
                f"{shown(folder)}: frame {frame} is there twice ({shown(files[frame].name)}, "
                f"{shown(name)}); expected one file a frame. Remove one."
            )
        files[frame] = folder / name
    if files:
        _check_whole(folder, names, files, re.compile(f"{start}{_SUBFRAME}{end}"))
    return dict(sorted(files.items()))


def _check_whole(
    folder: Path, names: list[str], files: dict[int, Path], subframe: re.Pattern[str]
) -> None:
    """Refuse frames between whole ones: `sky.1001.5.exr` next to `sky.1001.exr`."""
    for name in names:
        match = subframe.fullmatch(_composed(name))
        if match is not None and min(files) <= int(match[1]) <= max(files):
            raise _subframe(folder, name)


def _by_pattern(path: Path) -> FrameFiles:
    folder = path.parent
    if not folder.is_dir():
        raise InputError(
            f"{shown(path)}: there is no folder {shown(folder)}; expected a file, a folder or a "
            "pattern such as sky.####.exr. Check the path."
        )
    names = _file_names(folder)
    # The last place first: what comes before it is most often a size or a version.
    places = list(_PAD.finditer(path.name))[::-1]
    found = [one for place in places for one in _at(folder, names, path, place)]
    if found:
        return found[0]
    if places:
        base, extension = path.name[: places[0].start()], path.name[places[0].end() :]
        raise _nothing(path, f"no file is named {shown(base)}<frame>{shown(extension)}")
    raise _nothing(path, "is not there")


def _at(folder: Path, names: list[str], path: Path, place: re.Match[str]) -> Iterator[FrameFiles]:
    """Yield what a pattern means if its frame is at a place, with a range there and without."""
    extension = path.name[place.end() :]
    starts = [place.start("pad")] if place["range"] is None else [place.start(), place.start("pad")]
    for start in starts:
        base = path.name[:start]
        files = _by_frame(folder, names, base, extension)
        if files:
            text = path.name[start : place.start("pad")]
            yield FrameFiles(folder, base, extension, files, _asked(text, path) if text else None)


def _asked(text: str, path: Path) -> tuple[int, ...]:
    """Return the frames that the range of a pattern asks for, as fileseq reads it."""
    try:
        frames = FileSequence(f"_.{text}#.exr").frameRange()
    except ValueError as error:
        raise InputError(
            f"{shown(path)}: is no pattern ({compressed(str(error))}); expected one such as "
            "sky.####.exr or sky.1001-1048#.exr."
        ) from error
    return frame_set(frames or text, shown(path))


def _nothing(path: Path, found: str) -> InputError:
    """Say what is missing and what comes closest in the same folder."""
    if has_backslash(path):
        return InputError(
            f"{shown(path)}: {found}; expected a file, a folder or a pattern. A backslash "
            f"separates no folders here: write {shown(forward(path))}."
        )
    groups = _groups(path.parent)
    titles = _titles(groups)
    names = dict(zip(_titles(groups, with_frames=False), titles, strict=True))
    nearest = [names[name] for name in difflib.get_close_matches(path.name, names, n=1)]
    held = listing(titles) if titles else "no image"
    hint = f"Nearest in that folder: {nearest[0]}." if nearest else f"That folder holds {held}."
    return NothingThereError(
        f"{shown(path)}: {found}; expected a file, a folder or a pattern such as sky.####.exr. "
        f"{shown(hint)}"
    )
