//! Arm controller: joint, Cartesian and zero-reaction motion
