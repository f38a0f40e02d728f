"""External torque and contact force from joint measurements."""
