# SPDX-License-Identifier: Apache-2.0
"""Stiff, extreme and broken input: the cases, their checks, their table."""
