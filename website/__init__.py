# SPDX-License-Identifier: Apache-2.0
"""The pages of docs/ as a site: what `mkdocs build` does beyond rendering Markdown."""
