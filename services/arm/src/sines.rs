//! Joints that move in sines, to be identified.

use crate::ArmConfig;
use crate::profile::{PEAK_RATE, quintic};
use crate::reference::Reference;
use fss_messages::{MAX_SINES, MissionState};
use fss_multibody::{JointVector, MAX_LINKS};
use std::f64::consts::TAU;

/// Time in which sines fade in and out, s.
const FADE_S: f64 = 3.0;

/// Sines of every joint about given angles, from rest to rest.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sines {
    from: JointVector,
    about: JointVector,
    /// Amplitude rad, angular frequency rad/s, phase rad of every sine, joint after joint.
    terms: [[(f64, f64, f64); MAX_SINES]; MAX_LINKS],
    /// Time since the start of the phase, s.
    clock_s: f64,
    /// When the fading in began, and how long the way to the middle takes, s.
    begun_s: f64,
    approach_s: f64,
    duration_s: f64,
    /// Share of the amplitudes that the joints' rates and limits allow.
    pub(crate) share: f64,
}

impl Sines {
    /// What `mission` asks for, `late_s` after its phase began, from where the reference is.
    pub(crate) fn of(mission: &MissionState, config: &ArmConfig, reference: &Reference, late_s: f64) -> Self {
        let count = config.model.link_count();
        let mut sines = Self {
            from: reference.q_rad,
            about: reference.q_rad,
            terms: [[(0.0, 0.0, 0.0); MAX_SINES]; MAX_LINKS],
            clock_s: late_s,
            begun_s: late_s,
            approach_s: FADE_S,
            duration_s: mission.arm_duration_s,
            share: 1.0,
        };
        for i in 0..count {
            let reach = Reference::reach(config, i);
            sines.about[i] = mission.q_goal_rad[i].clamp(-reach, reach);
            let fastest_s = PEAK_RATE * (sines.about[i] - sines.from[i]).abs() / config.max_rate_rad_s[i];
            sines.approach_s = sines.approach_s.max(fastest_s);
            let (mut fastest, mut farthest) = (0.0, 0.0);
            for (k, term) in sines.terms[i].iter_mut().enumerate() {
                let slot = i * MAX_SINES + k;
                *term = (
                    mission.sine_amplitude_rad[slot],
                    TAU * mission.sine_frequency_hz[slot],
                    mission.sine_phase_rad[slot],
                );
                fastest += term.0.abs() * (term.1 + PEAK_RATE / FADE_S);
                farthest += term.0.abs();
            }
            if farthest > 0.0 {
                let room = reach - sines.about[i].abs().max(sines.from[i].abs());
                sines.share = sines.share.min(config.max_sine_rate_rad_s[i] / fastest).min((room / farthest).max(0.0));
            }
        }
        sines
    }

    /// The rest of the motion, from where the reference was stopped.
    pub(crate) fn resumed(&self, reference: &Reference) -> Self {
        Self { from: reference.q_rad, begun_s: self.clock_s, ..*self }
    }

    /// Whether the motion has left the reference that it moves.
    pub(crate) fn was_interrupted(&self, reference: &Reference) -> bool {
        (self.at(self.clock_s).0 - reference.q_rad).amax() > 1e-9
    }

    /// Moves the reference on; returns the share of the time that is over.
    pub(crate) fn advance(&mut self, reference: &mut Reference, dt_s: f64) -> f64 {
        self.clock_s += dt_s;
        (reference.q_rad, reference.qd_rad_s) = self.at(self.clock_s);
        (self.clock_s / self.duration_s).clamp(0.0, 1.0)
    }

    /// Angles and rates at a time of the phase.
    fn at(&self, t_s: f64) -> (JointVector, JointVector) {
        let (near, near_rate) = quintic(t_s - self.begun_s, self.approach_s);
        let (fade_in, fade_in_rate) = quintic(t_s - self.begun_s, FADE_S);
        let (fade_out, fade_out_rate) = quintic(t_s - (self.duration_s - FADE_S), FADE_S);
        let envelope = fade_in * (1.0 - fade_out);
        let envelope_rate = fade_in_rate * (1.0 - fade_out) - fade_in * fade_out_rate;
        let mut q = self.from + (self.about - self.from) * near;
        let mut qd = (self.about - self.from) * near_rate;
        for (i, terms) in self.terms.iter().enumerate() {
            for (amplitude, omega, phase) in terms {
                let amplitude = amplitude * self.share;
                let (sin, cos) = (omega * t_s + phase).sin_cos();
                q[i] += envelope * amplitude * sin;
                qd[i] += amplitude * (envelope * omega * cos + envelope_rate * sin);
            }
        }
        (q, qd)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn two_sines() -> Sines {
        let mut terms = [[(0.0, 0.0, 0.0); MAX_SINES]; MAX_LINKS];
        terms[0] = [(0.3, 0.9, 0.2), (0.1, 2.1, 1.0), (0.0, 0.0, 0.0)];
        terms[2] = [(-0.2, 1.3, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)];
        let from = JointVector::from_fn(|i, _| 0.1 * i as f64);
        let about = JointVector::repeat(0.4);
        Sines { from, about, terms, clock_s: 0.0, begun_s: 0.0, approach_s: 4.0, duration_s: 20.0, share: 1.0 }
    }

    #[test]
    fn sines_go_from_rest_to_rest_and_their_rate_is_their_derivative() {
        let sines = two_sines();
        assert_eq!(sines.at(0.0), (sines.from, JointVector::zeros()));
        assert_eq!(sines.at(20.0), (sines.about, JointVector::zeros()));
        let step = 1e-5;
        for t in [0.5, 2.9, 3.5, 10.0, 18.5, 19.9] {
            let difference = (sines.at(t + step).0 - sines.at(t - step).0) / (2.0 * step);
            assert!((difference - sines.at(t).1).amax() < 1e-7, "at {t} s");
        }
    }

    #[test]
    fn sines_that_were_stopped_go_on_without_a_jump() {
        let mut sines = two_sines();
        sines.clock_s = 9.0;
        let stopped = Reference { q_rad: JointVector::repeat(0.25), qd_rad_s: JointVector::zeros() };
        assert!(sines.was_interrupted(&stopped));
        let resumed = sines.resumed(&stopped);
        assert!(!resumed.was_interrupted(&stopped));
        assert_eq!(resumed.at(20.0).0, sines.about);
    }
}
