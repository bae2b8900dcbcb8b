//! n-link planar floating-base kinematics and dynamics
