//! The simulated laboratory: granite, vehicles, links, cameras, gyro, valves
