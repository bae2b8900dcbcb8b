//! Owns the valves: applies commands, shuts them when commands stop
