# SPDX-License-Identifier: Apache-2.0
"""What is looked at before a stage is trusted, and the contract that a written stage keeps."""
