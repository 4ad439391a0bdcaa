# SPDX-License-Identifier: Apache-2.0
"""What a fit minimises: adaptive cells of the map, what lobes show there, J, the temporal term."""
