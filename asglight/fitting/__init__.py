# SPDX-License-Identifier: Apache-2.0
"""From radiance maps to lobe tracks: losses, seeding, first frame, following, whole shot."""
