# SPDX-License-Identifier: Apache-2.0
"""Python for arrays and live feeds: fits of arrays, the light of tracks at any time, a follower."""
