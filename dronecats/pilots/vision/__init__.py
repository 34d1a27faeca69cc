"""The vision pilot: a classical computer vision pilot. Its only inputs are the camera images and the prompt."""
