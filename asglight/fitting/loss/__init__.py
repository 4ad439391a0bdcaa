# SPDX-License-Identifier: Apache-2.0
"""What a fit minimises: leaves of the map, what lobes and materials show, J, the temporal term."""
