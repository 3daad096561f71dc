"""Robots: one URDF, read once and checked."""

from bodyimage_kin.robot.robot import Robot as Robot

__all__ = ["Robot"]
