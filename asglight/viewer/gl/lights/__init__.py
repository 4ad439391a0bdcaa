# SPDX-License-Identifier: Apache-2.0
"""Other lights than the lobes that are edited: keys with their rest, and another fit."""
