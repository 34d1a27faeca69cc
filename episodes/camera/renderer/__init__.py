"""The forward camera of the simulated world: colour, planar depth and instance ids of a scene, drawn on the CPU.

`pose` says where the camera is, `triangles` and `textures` lay the scene out for the kernels, `visibility` finds the
triangle that each sample sees, `shadow` what the sun sees, `shading` and `sky` give light, `resolve` smooths the edges
and encodes, and `renderer` runs them in that order.
"""

from episodes.camera.renderer.layout import camera_pose
from episodes.camera.renderer.renderer import Renderer, View

__all__ = ["Renderer", "View", "camera_pose"]
