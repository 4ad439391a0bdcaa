# SPDX-License-Identifier: Apache-2.0
"""What was edited, as a layer over the stage, whose own files stay as they are."""
