# SPDX-License-Identifier: Apache-2.0
"""Processes of multiprocessing that have torch and the fit loaded from the start.

They are forks of one process that has loaded them (preloaded.py), once for all tests of a process.
It is no fork of that one, whose windows and threads cannot be continued in a copy.
"""

import multiprocessing
import os
from multiprocessing import forkserver
from multiprocessing.context import ForkServerContext

import pytest
from places import ROOT, SUPPORT

_get_context = multiprocessing.get_context  # which tests replace by `context`


def context(_: str = "spawn") -> ForkServerContext:
    """Return what starts such processes, in place of `multiprocessing.get_context`."""
    found = _get_context("forkserver")
    found.set_forkserver_preload(["preloaded"])
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", os.pathsep.join(map(str, (ROOT, SUPPORT))))
        patch.setenv("OMP_NUM_THREADS", "1")  # OpenMP with threads hangs in a process forked off
        forkserver.ensure_running()  # the first time; it stays until this process ends
    return found
