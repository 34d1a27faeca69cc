"""The forward camera of the simulated world: colour, planar depth and instance ids of a scene, drawn on the CPU.

`layout` and `textures` lay the scene out for the kernels, `coverage` finds the triangle of each sample, `shadow` the
shadows, `shading` and `sky` the light and the picture with smooth edges, and `renderer` runs them in that order.
"""

from episodes.camera.renderer.renderer import Renderer, View

__all__ = ["Renderer", "View"]
