# SPDX-License-Identifier: Apache-2.0
"""Every table and picture of the Results pages and of README.md, made anew by one command."""
