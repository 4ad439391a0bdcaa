# SPDX-License-Identifier: Apache-2.0
"""What a shot keeps on disk while it runs: its checkpoint, and reduced frames."""
