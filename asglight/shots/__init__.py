# SPDX-License-Identifier: Apache-2.0
"""A shot as a job: read, fit, checkpoint, resume, write."""

from asglight.shots.job import ShotResult, fit_sequence, fit_shot

__all__ = ["ShotResult", "fit_sequence", "fit_shot"]
