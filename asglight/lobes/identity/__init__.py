# SPDX-License-Identifier: Apache-2.0
"""Which lobe is which: tracks that stay on their lamps, and names that stay over new fits."""
