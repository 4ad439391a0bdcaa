# SPDX-License-Identifier: Apache-2.0
"""The panels of the window: each function draws one and changes the state."""
