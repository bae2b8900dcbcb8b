//! Device protocols: every byte that crosses between the vehicle's computer and a device, or another vehicle.
//!
//! | module | device | transport |
//! | --- | --- | --- |
//! | [`mocap`] | overhead motion capture, whoever made it | one of the next three |
//! | [`vicon`] | VICON | UDP, the Tracker object stream |
//! | [`natnet`] | OptiTrack | UDP, NatNet 3 and 4, unicast or multicast |
//! | [`vrpn`] | trackers behind VRPN | TCP, or UDP for the poses |
//! | [`dsp3000`] | fibre-optic gyro KVH DSP-3000 | RS-232, 38400 8N1, ASCII lines |
//! | [`link`] | one modular arm link | UDP, a datagram of our own |
//! | [`valves`] | the thruster valves of the simulated laboratory | Unix stream, 8-byte frames |
//! | [`shared_table`] | another vehicle's simulated laboratory on the same table | UDP, a datagram of our own |
//! | [`bridge`] | another vehicle | beside each sample over zenoh |
//!
//! Each module has an encoder and a decoder, because the laboratory speaks as the device and a service listens. Decoders
//! take whatever arrives: they never panic, never allocate, look at a bounded number of bytes, and name what is wrong.
//! Numbers on the wire are little endian and packed, but for VRPN's. No socket, file or clock is touched here.

#![forbid(unsafe_code)]

pub mod bridge;
mod bytes;
pub mod dsp3000;
pub mod link;
pub mod mocap;
pub mod natnet;
pub mod shared_table;
pub mod valves;
pub mod vicon;
pub mod vrpn;
