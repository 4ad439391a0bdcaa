# SPDX-License-Identifier: Apache-2.0
"""Reading lobe tracks back, also where lights were edited in another program."""
