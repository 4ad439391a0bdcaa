# SPDX-License-Identifier: Apache-2.0
"""What steps of a fit cost, and what their rounding does."""
