"""PX4's simulator interface: sensors to an autopilot that is not ours, actuators back."""
