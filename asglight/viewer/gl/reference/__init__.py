# SPDX-License-Identifier: Apache-2.0
"""Balls under a map: the sampled integral, tables and previews without noise, pictures kept."""
