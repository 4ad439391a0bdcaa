# SPDX-License-Identifier: Apache-2.0
"""What other programs load: one folder a program, each with a licence of its own."""
