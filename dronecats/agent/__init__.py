"""The pilot: prompt, model, action, geometric controller. Sees a frame, an instruction, its history, and MAVLink."""
