# SPDX-License-Identifier: Apache-2.0
"""One thread for a while, and what was allowed before from then on."""

from collections.abc import Iterator

import pytest
import torch

from asglight.threads import one_thread


@pytest.fixture(autouse=True)
def allowed() -> Iterator[None]:
    """Allow four threads."""
    before = torch.get_num_threads()
    torch.set_num_threads(4)
    yield
    assert torch.get_num_threads() == 4
    torch.set_num_threads(before)


def test_one_thread_is_one_and_gives_back_what_was() -> None:
    with one_thread():
        assert torch.get_num_threads() == 1
    with pytest.raises(KeyError), one_thread():
        raise KeyError
