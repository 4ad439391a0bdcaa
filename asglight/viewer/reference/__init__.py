# SPDX-License-Identifier: Apache-2.0
"""The images that lobes are compared with: opened, decoded ahead, split for sampling."""
