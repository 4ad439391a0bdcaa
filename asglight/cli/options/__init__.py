# SPDX-License-Identifier: Apache-2.0
"""Arguments of commands: the parser, and options that several commands share."""
