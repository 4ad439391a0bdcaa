# SPDX-License-Identifier: Apache-2.0
"""A shot in parts that are fitted apart, on one machine or many, and joined."""
