# SPDX-License-Identifier: Apache-2.0
"""The lobes of the session: their list, the controls of those selected, the history of edits."""
