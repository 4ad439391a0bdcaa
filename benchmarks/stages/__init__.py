# SPDX-License-Identifier: Apache-2.0
"""Stages: size, time, and how each representation shows the light."""
