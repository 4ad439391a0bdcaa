# SPDX-License-Identifier: Apache-2.0
"""What the viewer is opened on: where its lobes and images come from."""
