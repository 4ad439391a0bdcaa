# SPDX-License-Identifier: Apache-2.0
"""How wrong a fit is, in numbers and in pictures."""
