//! Device protocols: VICON object stream, DSP-3000 line, link datagram
