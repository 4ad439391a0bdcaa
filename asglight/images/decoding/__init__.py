# SPDX-License-Identifier: Apache-2.0
"""Decoding the pixels of image files, apart from the process that uses them."""
