# SPDX-License-Identifier: Apache-2.0
"""Every method on the same map, judged in one way."""
