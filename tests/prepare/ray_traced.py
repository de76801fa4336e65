"""A scene with jumps of every kind, ray-traced from anywhere: the truth for the depth sensor."""

import numpy as np

from rakelight.model import Camera, RigidTransform
from rakelight.synthetic.implicit import Solid, seen_from, trace

DISTANCE_M = 0.8
COLOUR = Camera(480, 360, fx=450.0, fy=453.0, cx=241.0, cy=177.0)


def _field(x, y, z):
    """A ball before a slanted wall, and a post before the ball."""
    ball = np.sqrt(x**2 + y**2 + z**2) - 0.1
    wall = z + 0.25 + 0.1 * x
    post = np.sqrt((x - 0.06) ** 2 + (z - 0.16) ** 2) - 0.012
    both = np.where(ball.real < wall.real, ball, wall)
    return np.where(both.real < post.real, both, post)


SCENE = Solid(_field, DISTANCE_M, radius_m=0.6, steepness=1.1)


def turned(degrees, axis):
    """(3, 3) rotation by an angle about an axis (Rodrigues)."""
    x, y, z = np.asarray(axis) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = np.radians(degrees)
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


POSE = RigidTransform(turned(1.5, [0.3, 1.0, 0.2]), np.array([0.05, -0.004, 0.006]))


def depth_of(camera, pose=None):
    """(h, w) depth at the pixel centres of a camera at `pose` from the colour camera."""
    return trace(SCENE if pose is None else seen_from(SCENE, pose), camera).depth
