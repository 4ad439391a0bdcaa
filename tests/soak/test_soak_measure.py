# SPDX-License-Identifier: Apache-2.0
"""The whole soak tells what each of its parts took, while the others still run."""

import pytest

from soak.measure import Parts


def test_a_part_is_told_of_when_it_ends(capsys: pytest.CaptureFixture[str]) -> None:
    parts = Parts()
    assert parts.done("Faults", lambda: sum(range(1000))) == 499_500
    assert capsys.readouterr().err == "Faults: 0 s, 0 s of processor time.\n"
    (took,) = parts.took
    assert took.part == "Faults"
    assert 0 <= took.cpu_seconds <= took.seconds + 0.02  # two ticks of the processor's clock
