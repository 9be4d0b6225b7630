"""Step 1 of the paper: the rig's kinematics, camera calibration, colour from pictures onto points."""
