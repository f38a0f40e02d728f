"""Where people touch the robot, from depth images and joint torques."""
