"""How late a loop of the cascade may hear of the vehicle, and how late the cascade may hear of the agent."""
