# SPDX-License-Identifier: Apache-2.0
"""`asglight`: chooses the command, and turns whatever ends it into an exit status.

0    done
1    a bug: traceback, and a request to report it
2    the input, an option or the disk is at fault: one line
3    done, and above a limit that was asked for (`eval`, `bench`), or a case failed (`stress`)
130  interrupted (128 + SIGINT), 141 standard output was closed early (128 + SIGPIPE)
"""

import argparse
import contextlib
import errno
import gc
import importlib
import os
import sys
import traceback
from collections.abc import Iterator, Sequence
from types import ModuleType

from asglight import __version__
from asglight.cli.options.parser import Parser, one_line
from asglight.errors import InputError

COMMANDS = {
    "fit": "fit lobes to an image or sequence and write them as USD lights",
    "follow": "fit a live feed, a line of JSON for each frame",
    "stitch": "join stages of parts of a shot that were fitted apart",
    "resample": "write a stage at another frame rate or speed",
    "keys": "cut lamps out of images as lights of a stage, and keep the rest",
    "eval": "measure the error of a stage against the images it was fitted to",
    "info": "show what a stage holds, or what is read of images",
    "export": "write a page, or lobes for engines, glTF, PhySG and NeRD",
    "import": "make a stage of lights of PhySG or NeRD",
    "view": "show lobes and images in a window, or write a picture of them",
    "compare": "set every method side by side on the same map and budget",
    "bench": "measure error against run time, and time against size",
    "figures": "draw the figures of Clausen et al. 2024, with numbers",
    "stress": "measure what becomes of stiff, extreme and broken input",
    "demo": "fit the built-in moving environment and draw what came out",
}
_MODULES = {name: f"asglight.cli.commands.{name}" for name in COMMANDS} | {
    "eval": "asglight.cli.commands.evaluate",  # Python has words of these names
    "import": "asglight.cli.commands.importing",
}

DISK_ERRNOS = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return its exit status."""
    # Threads of torch that wait for others sleep. Those that spin take the processor from whom they
    # wait for: beside a renderer, moments of 19,000 lobes took 20 s of it, and take 0.4 s.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    # NumPy's matrices are small. On two threads beside a renderer keys took four times as long.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    _open_standard_streams()
    words = list(sys.argv[1:] if argv is None else argv)
    on_interrupt = "interrupted"
    try:
        _start_ahead(words)
        with _without_collections(argv is None), _tables_beside(words, argv is None):
            arguments = command_parser(words).parse_args(words)
        on_interrupt = arguments.on_interrupt
        status = arguments.run(arguments)
        sys.stdout.flush()
    except SystemExit as end:  # argparse: --help, --version, or an error that it has printed
        return end.code if isinstance(end.code, int) else 1
    except KeyboardInterrupt:
        return _complain(on_interrupt, 130)
    except BrokenPipeError:
        # Python would flush standard output again at exit, and fail again.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    except Exception as error:
        return _failed(error)
    finally:
        gc.unfreeze()  # or OpenImageIO takes what is left at the end for leaked
    return status


def _open_standard_streams() -> None:
    """Open what the caller has closed: another file would take its number, and be written to."""
    for number, name, mode in ((0, "stdin", "r"), (1, "stdout", "w"), (2, "stderr", "w")):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest number that is free
            os.set_inheritable(number, True)
            setattr(sys, name, os.fdopen(number, mode, encoding="utf-8", closefd=False))


def _start_ahead(words: list[str]) -> None:
    """Start the process that decodes images, which loads beside the fitter."""
    if _fits(words):
        from asglight.images.decoding.decoders import APART

        APART.prepare()


def _fits(words: list[str]) -> bool:
    """Tell whether a command fits in this process."""
    return words[:1] == ["fit"] and not {"-h", "--help", "--scheduler"} & set(words)


@contextlib.contextmanager
def _tables_beside(words: list[str], is_own_process: bool) -> Iterator[None]:
    """Make the tables of a first frame on another thread while other modules are loaded.

    They take as long as what is left to load after torch: together a tenth of a second.

    Args:
        words: Of the command.
        is_own_process: In one that had commands before, they are there.
    """
    if not (is_own_process and _fits(words)):
        yield
        return
    from asglight.fitting.first_frame import fit
    from asglight.threads import beside, threads_there

    if threads_there() < 2:
        yield
        return
    with beside([fit.prepare]):
        yield


@contextlib.contextmanager
def _without_collections(is_own_process: bool) -> Iterator[None]:
    """Load modules without looking for garbage among them: a tenth of the time that torch takes.

    Args:
        is_own_process: What is loaded stays until the end, so it is never looked at again.
    """
    if not (is_own_process and gc.isenabled()):
        yield
        return
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()


def command_parser(words: list[str]) -> Parser:
    """Return the parser, with the options of the named command only: the others stay unloaded."""
    parser = Parser(
        prog="asglight",
        description="HDR environment sequences as a few lights in time-sampled USD.",
        epilog="example: asglight fit sky.####.exr -o sky.usda",
    )
    parser.add_argument("--version", action="version", version=f"asglight {__version__}")
    commands = parser.add_subparsers(
        title="commands", metavar="COMMAND", required=True, parser_class=Parser
    )
    for name, summary in COMMANDS.items():
        sentence = f"{summary[0].upper()}{summary[1:]}."
        command = commands.add_parser(name, help=summary, description=sentence)
        if words[:1] == [name]:
            _load(name, command)
    return parser


def _load(name: str, command: argparse.ArgumentParser) -> None:
    module: ModuleType = importlib.import_module(_MODULES[name])
    command.epilog = f"example: {module.EXAMPLE}"
    command.set_defaults(
        run=module.run, on_interrupt=getattr(module, "ON_INTERRUPT", "interrupted")
    )
    module.add_arguments(command)


def _failed(error: Exception) -> int:
    """Report what ended a command other than the user."""
    if isinstance(error, InputError):
        return _complain(str(error), 2)
    if _is_out_of_memory(error):
        return _complain("not enough memory; use fewer lobes or close other programs", 2)
    if isinstance(error, OSError) and error.errno in DISK_ERRNOS:
        return _complain(f"{error.filename or 'output'}: {error.strerror}; make room for it", 2)
    traceback.print_exception(error)
    return _complain(
        f"this is a bug in asglight {__version__}; please report it with the lines above", 1
    )


def _is_out_of_memory(error: Exception) -> bool:
    # torch raises a RuntimeError of its own on a device, and a plain one on the CPU.
    is_torch = isinstance(error, RuntimeError) and (
        type(error).__name__ == "OutOfMemoryError" or "can't allocate memory" in str(error)
    )
    return is_torch or isinstance(error, MemoryError)


def _complain(message: str, status: int) -> int:
    print(f"asglight: {one_line(message)}", file=sys.stderr)
    return status
