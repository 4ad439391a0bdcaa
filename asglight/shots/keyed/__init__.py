# SPDX-License-Identifier: Apache-2.0
"""Images of keys and rest, and keys of stages that are put together or retimed."""
