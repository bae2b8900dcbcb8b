//! MCAP logs and measured experiments, written and read
