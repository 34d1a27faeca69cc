"""The camera: its optics and the renderer of its pictures."""
