"""The vision pilot: it sees the camera image and reads the prompt, and knows nothing else."""
