//! Records every topic to MCAP
