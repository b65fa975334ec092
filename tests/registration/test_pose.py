"""Five numbers of a pose are those of a placement, and a fit's steps go where they say."""

from __future__ import annotations

import numpy as np
import pytest

from prooflight.registration.pose import Pose, slopes
from prooflight.scans.placement import Placement

WIDTH_MM, HEIGHT_MM = 210.0, 297.0
X_MM, Y_MM = np.random.default_rng(1).uniform(-1, 1, (2, 50)) * np.array([[WIDTH_MM / 2], [HEIGHT_MM / 2]])


def test_points_of_the_page_are_seen_where_its_pose_moves_them() -> None:
    pose = Pose(x_mm=1.5, y_mm=-0.7, turn=np.deg2rad(0.8), across=2e-3, along=-1e-3)
    placement = Placement(shift_mm=(1.5, -0.7), skew_deg=0.8, stretch_percent=(0.2, -0.1))
    right, down = pose.displacement_mm(X_MM, Y_MM)
    there = X_MM + WIDTH_MM / 2 + right, Y_MM + HEIGHT_MM / 2 + down
    seen = placement.seen_mm(*there, page_width_mm=WIDTH_MM, page_height_mm=HEIGHT_MM)
    assert np.array(seen) == pytest.approx(np.array([X_MM + WIDTH_MM / 2, Y_MM + HEIGHT_MM / 2]))


def test_a_clockwise_turn_takes_the_right_edge_down() -> None:
    right, down = Pose(turn=np.deg2rad(90)).displacement_mm(np.array([10.0]), np.array([0.0]))
    assert (right[0], down[0]) == pytest.approx((-10.0, 10.0))


def test_slopes_are_what_small_steps_displace_points_by() -> None:
    every = slopes(X_MM, Y_MM)
    for number, step in enumerate(1e-6 * np.eye(5)):
        moved = np.array(Pose().moved(step).displacement_mm(X_MM, Y_MM))
        assert moved / 1e-6 == pytest.approx(every[..., number], abs=1e-3)


def test_steps_of_a_fit_add_up() -> None:
    step = np.array([1.0, 2.0, 3e-3, 4e-3, 5e-3])
    assert Pose().moved(step).moved(2 * step) == Pose(
        x_mm=3.0, y_mm=6.0, turn=pytest.approx(9e-3), across=pytest.approx(12e-3), along=pytest.approx(15e-3)
    )
