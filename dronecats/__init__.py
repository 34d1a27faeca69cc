"""DroneCATS: a multimodal model as the pilot of a drone, and the benchmark that measures it."""

from foundation.version import __version__ as __version__
