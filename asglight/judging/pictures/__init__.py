# SPDX-License-Identifier: Apache-2.0
"""What pictures and charts are made of."""
