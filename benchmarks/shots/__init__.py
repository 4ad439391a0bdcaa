# SPDX-License-Identifier: Apache-2.0
"""Whole shots: turned, hard, in parts, and what flickers."""
