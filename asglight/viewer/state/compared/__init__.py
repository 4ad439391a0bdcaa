# SPDX-License-Identifier: Apache-2.0
"""What is held against what: another fit, and what the pictures of both are called."""
