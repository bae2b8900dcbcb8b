//! What the simulated laboratories of two vehicles on one table tell each other, a thousand times a second.
//!
//! On granite two vehicles see, touch and hold each other. Each is simulated by a laboratory of its own; so that they share a
//! table, each tells the other where its vehicle is, what its arm did to the other's vehicle, and, while its gripper holds
//! that, where it takes it. Both run on one computer: times are those of its monotonic clock.
//!
//! A datagram of [`STATE_LEN`] bytes, little endian and packed:
//!
//! | offset | type | field |
//! | --- | --- | --- |
//! | 0 | u8\[4\] | magic, `FSSG` |
//! | 4 | u32 | version, 1 |
//! | 8 | u64 | session: when the laboratory started (ns) |
//! | 16 | u64 | time of the state (ns) |
//! | 24 | f64\[3\] | pose of the vehicle's base, table frame (m, m, rad) |
//! | 48 | f64\[3\] | its velocity (m/s, m/s, rad/s) |
//! | 72 | f64 | mass of the vehicle (kg) |
//! | 80 | f64\[2\] | all that its arm's tip has pushed the other vehicle so far, table axes (N s) |
//! | 96 | f64\[2\] | the sum of the other's pushes that it has come to (N s) |
//! | 112 | u64 | 1 while its gripper holds the other vehicle, else 0 |
//! | 120 | f64\[3\] | where it takes the other vehicle's base, table frame (m, m, rad) |
//! | 144 | f64\[3\] | with what velocity (m/s, m/s, rad/s) |
//!
//! Pushes are sums, so that a datagram that is lost loses none; each side counts the other's from where it first heard of
//! them in a session.

use crate::bytes::Reader;

/// Bytes of a datagram.
pub const STATE_LEN: usize = 168;
const MAGIC: [u8; 4] = *b"FSSG";
const VERSION: u32 = 1;
/// Numbers after the time and before the word that says whether something is held.
const FIRST_NUMBERS: usize = 11;

/// A vehicle on the table, as its laboratory tells the other one.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct State {
    /// When the laboratory started (ns).
    pub session: u64,
    /// When this was so, on the computer's monotonic clock (ns).
    pub time_ns: u64,
    /// Of the vehicle's base, table frame (m, m, rad).
    pub pose: [f64; 3],
    /// Of the vehicle's base (m/s, m/s, rad/s).
    pub velocity: [f64; 3],
    /// Of the whole vehicle (kg).
    pub mass_kg: f64,
    /// All that its arm's tip has pushed the other vehicle so far (N s).
    pub pushed_n_s: [f64; 2],
    /// The sum of the other's pushes that it has come to (N s).
    pub taken_n_s: [f64; 2],
    /// Pose and velocity of the other vehicle's base while the gripper holds it.
    pub held: Option<[[f64; 3]; 2]>,
}

impl State {
    /// As it travels.
    pub fn encode(&self) -> [u8; STATE_LEN] {
        let mut bytes = [0; STATE_LEN];
        bytes[..4].copy_from_slice(&MAGIC);
        bytes[4..8].copy_from_slice(&VERSION.to_le_bytes());
        let [held_pose, held_velocity] = self.held.unwrap_or_default();
        let numbers = self.pose.iter().chain(&self.velocity).chain(std::iter::once(&self.mass_kg));
        let first = numbers.chain(&self.pushed_n_s).chain(&self.taken_n_s).map(|number| number.to_le_bytes());
        let last = held_pose.iter().chain(&held_velocity).map(|number| number.to_le_bytes());
        let words = [self.session.to_le_bytes(), self.time_ns.to_le_bytes()]
            .into_iter()
            .chain(first)
            .chain(std::iter::once(u64::from(self.held.is_some()).to_le_bytes()))
            .chain(last);
        for (slot, word) in bytes[8..].as_chunks_mut::<8>().0.iter_mut().zip(words) {
            *slot = word;
        }
        bytes
    }

    /// Reads one; `None` where it is none: another length, magic or version, or a number that is not finite.
    pub fn decode(bytes: &[u8]) -> Option<Self> {
        let mut reader = Reader(bytes);
        if bytes.len() != STATE_LEN || reader.array()? != MAGIC || reader.u32()? != VERSION {
            return None;
        }
        let (session, time_ns) = (reader.u64()?, reader.u64()?);
        let mut first = [0.0; FIRST_NUMBERS];
        for number in &mut first {
            *number = f64::from_bits(reader.u64()?);
        }
        let [x, y, theta, vx, vy, omega, mass_kg, pushed_x, pushed_y, taken_x, taken_y] = first;
        let holds = reader.u64()?;
        let held = [reader.f64x3()?, reader.f64x3()?];
        let is_finite = first.iter().chain(held.as_flattened()).all(|number| number.is_finite());
        (is_finite && holds <= 1).then_some(Self {
            session,
            time_ns,
            pose: [x, y, theta],
            velocity: [vx, vy, omega],
            mass_kg,
            pushed_n_s: [pushed_x, pushed_y],
            taken_n_s: [taken_x, taken_y],
            held: (holds == 1).then_some(held),
        })
    }
}
