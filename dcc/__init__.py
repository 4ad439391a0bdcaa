# SPDX-License-Identifier: Apache-2.0
"""Stages of asglight rendered by programs that share nothing with it, and judged.

`python -m dcc.measure` does all of it. `blender_render.py` and `mitsuba_render.py` run under an
interpreter of their own, which has neither torch nor asglight; the rest runs under asglight's.
"""
