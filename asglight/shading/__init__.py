# SPDX-License-Identifier: Apache-2.0
"""What lobes and maps look like on surfaces: the GGX reference, by brute force."""
