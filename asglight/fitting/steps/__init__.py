# SPDX-License-Identifier: Apache-2.0
"""How J falls: Levenberg-Marquardt, the light of given shapes, and what it is certain of."""
