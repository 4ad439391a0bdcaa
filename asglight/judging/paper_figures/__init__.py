# SPDX-License-Identifier: Apache-2.0
"""The paper's figures, with numbers."""
