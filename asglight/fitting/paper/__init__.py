# SPDX-License-Identifier: Apache-2.0
"""The method of Clausen et al. 2024, as published."""
