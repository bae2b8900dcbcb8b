//! Sensor fusion: VICON and gyro to the navigation state
