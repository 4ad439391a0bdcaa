# SPDX-License-Identifier: Apache-2.0
"""Images from the field, and of production resolution."""
