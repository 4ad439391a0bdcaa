# SPDX-License-Identifier: Apache-2.0
"""Files that the viewer reads and writes: unsaved edits kept, folders listed, pictures rendered."""
