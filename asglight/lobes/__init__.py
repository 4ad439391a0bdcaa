# SPDX-License-Identifier: Apache-2.0
"""Lobes and tracks as data; ASG maths; frames and their continuity."""

from asglight.lobes.data import Form, Lobes, LobeTracks

__all__ = ["Form", "LobeTracks", "Lobes"]
