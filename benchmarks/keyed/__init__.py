# SPDX-License-Identifier: Apache-2.0
"""Key lights and the rest."""
