"""DroneCATS: a multimodal model as the pilot of a drone, and the benchmark that measures it."""

__version__ = "0.1.0"
