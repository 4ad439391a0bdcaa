# SPDX-License-Identifier: Apache-2.0
"""Other methods that turn a map into lobes, one file each, from the literature, in our own code."""
