"""Real cameras: frames with time stamps, and without lens distortion, from any address."""
