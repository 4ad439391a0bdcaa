# SPDX-License-Identifier: Apache-2.0
"""The time that is shown: the playhead, and the part of the shot that the timeline has."""
