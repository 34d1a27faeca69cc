"""Renders the forward camera on the CPU: colour, planar depth and instance ids of a scene.

`layout` and `textures` prepare the arrays of a scene. `coverage` finds the triangle of each sample. `shadow`,
`occlusion`, `environment` and `sky` describe the light. `shading` computes the picture with smooth edges. `renderer`
runs these steps.
"""

from episodes.camera.renderer.renderer import Renderer, View

__all__ = ["Renderer", "View"]
