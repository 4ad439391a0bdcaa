# SPDX-License-Identifier: Apache-2.0
"""The table of moving shots in Blender: a line for each shot and way."""

from dcc.moving.measure import LIMIT, Row, table


def test_a_line_has_the_errors_of_its_times_in_their_order() -> None:
    rows = [
        Row("day", "hook, cards", 1001.0, 0.004, 1.0, 0.001),
        Row("day", "hook, cards", 1025.0, 0.002, 1.0, 0.003),
        Row("day", "hook, cards", 1048.0, LIMIT + 0.001, 1.0, 0.002),
        Row("day", "hook, cards", 1025.5, 0.003, 1.0, 0.001),
        Row("sky", "importer, dome", 1001.0, 0.005, 1.0, 0.001),
        Row("sky", "importer, dome", 1001.5, 0.006, 1.0, 0.001),
        Row("sky", "importer, dome", 1003.0, 0.007, 1.0, 0.001),
    ]
    assert table(rows).splitlines() == [
        "| shot | through | first | middle | last | half frame | noise |",
        "| --- | --- | ---: | ---: | ---: | ---: | ---: |",
        f"| day | hook, cards | 0.40 | 0.20 | {100 * LIMIT + 0.1:.2f} ABOVE | 0.30 | 0.30 |",
        "| sky | importer, dome | 0.50 | – | 0.70 | 0.60 | 0.10 |",
    ]
