"""From measured values to torques, one pipeline for each way of control."""
