# SPDX-License-Identifier: Apache-2.0
"""Writing: layers authored, files staged beside their target, edits as a layer."""
