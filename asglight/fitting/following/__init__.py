# SPDX-License-Identifier: Apache-2.0
"""Frames that follow another, and the pass over the whole shot."""
