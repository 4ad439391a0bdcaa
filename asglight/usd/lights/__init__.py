# SPDX-License-Identifier: Apache-2.0
"""A lobe as the lights of each representation, as data: no stage is opened here."""
