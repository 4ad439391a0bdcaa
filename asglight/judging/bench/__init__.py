# SPDX-License-Identifier: Apache-2.0
"""Error against run time: what is run, its page, its gate."""
