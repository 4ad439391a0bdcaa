# SPDX-License-Identifier: Apache-2.0
"""Balls by lobes and by images, and the time of a picture."""
