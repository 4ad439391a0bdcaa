# SPDX-License-Identifier: Apache-2.0
"""What a user changes of the lobes: edits, their history, and the edit under the hand."""
