"""The pilot: prompt, model, actions, geometric controller. Its inputs: frame, instruction, history, MAVLink."""
