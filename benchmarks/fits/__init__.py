# SPDX-License-Identifier: Apache-2.0
"""How good fits are beside EM, how fast beside the paper, how steady over time."""
