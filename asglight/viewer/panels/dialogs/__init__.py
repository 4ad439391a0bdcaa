# SPDX-License-Identifier: Apache-2.0
"""What stands over the panels until it is answered or done."""
