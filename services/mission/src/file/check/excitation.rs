//! Valve pulses and joint sines: what a phase of excitation may ask for.

use super::{Checked, For, number, number_or_zero};
use crate::error::Fault;
use crate::file::{Pulse, Sine, raw};
use fss_messages::{MAX_SINES, MAX_THRUSTERS};
use std::f64::consts::TAU;
use toml::Spanned;

/// The pulses of a phase that lasts `phase_s`.
pub(super) fn pulses(raw: &raw::Base, phase_s: f64, plant: For) -> Checked<Vec<Pulse>> {
    let Some(pulses) = &raw.pulses else {
        return Err(Fault::new(raw.goal.span(), "missing field `pulses`", "add the key to this table"));
    };
    let count = plant.map_or(MAX_THRUSTERS, |plant| plant.thrusters.len());
    let checked = |pulse: &raw::Pulse| {
        let (at_s, for_s) = (number(&pulse.at_s)?, number(&pulse.for_s)?);
        if at_s < 0.0 {
            return Err(Fault::new(pulse.at_s.span(), format!("a pulse cannot begin at {at_s} s"), "give 0 or later"));
        }
        if for_s <= 0.0 {
            return Err(Fault::new(pulse.for_s.span(), format!("a pulse cannot last {for_s} s"), "give more than 0 s"));
        }
        if at_s + for_s > phase_s + 1e-9 {
            let message = format!("the pulse ends at {} s, after its phase", at_s + for_s);
            return Err(Fault::new(pulse.for_s.span(), message, format!("the phase ends at {phase_s} s")));
        }
        Ok(Pulse { at_s, for_s, thrusters: numbers_from_one(&pulse.thrusters, count)? })
    };
    pulses.get_ref().iter().map(|pulse| checked(pulse.get_ref())).collect()
}

fn numbers_from_one(values: &Spanned<Vec<Spanned<usize>>>, count: usize) -> Checked<Vec<usize>> {
    if values.get_ref().is_empty() {
        return Err(Fault::new(values.span(), "the pulse opens no valve", "name a thruster, such as [1]"));
    }
    values.get_ref().iter().map(|value| from_one(value, count, "thruster")).collect()
}

fn from_one(value: &Spanned<usize>, count: usize, what: &str) -> Checked<usize> {
    let number = *value.get_ref();
    if (1..=count).contains(&number) {
        return Ok(number - 1);
    }
    Err(Fault::new(value.span(), format!("there is no {what} {number}"), format!("{what}s count from 1 to {count}")))
}

/// The sines of joints that move about `about_rad`.
pub(super) fn sines(raw: &Spanned<Vec<Spanned<raw::Sine>>>, about_rad: &[f64], plant: For) -> Checked<Vec<Sine>> {
    let mut sines: Vec<Sine> = Vec::new();
    for spanned in raw.get_ref() {
        let raw = spanned.get_ref();
        let joint = from_one(&raw.joint, about_rad.len(), "joint")?;
        let frequency_hz = number(&raw.frequency_hz)?;
        if frequency_hz <= 0.0 {
            let message = format!("a sine cannot have {frequency_hz} Hz");
            return Err(Fault::new(raw.frequency_hz.span(), message, "give a positive frequency"));
        }
        let amplitude_rad = number(&raw.amplitude_deg)?.to_radians();
        let phase_rad = number_or_zero(raw.phase_deg.as_ref())?.to_radians();
        sines.push(Sine { joint, amplitude_rad, frequency_hz, phase_rad });
        let own = || sines.iter().filter(|sine| sine.joint == joint);
        if own().count() > MAX_SINES {
            let message = format!("joint {} has more than {MAX_SINES} sines", joint + 1);
            return Err(Fault::new(spanned.span(), message, "remove some of them"));
        }
        let Some(plant) = plant else { continue };
        let limit = plant.links.get(joint).map_or(f64::INFINITY, |link| link.joint_limit_rad);
        let farthest = about_rad[joint].abs() + own().map(|sine| sine.amplitude_rad.abs()).sum::<f64>();
        if farthest > limit {
            let (there, limit) = (farthest.to_degrees(), limit.to_degrees());
            let message = format!("joint {} moves as far as {there:.1} degrees, beyond its stop", joint + 1);
            return Err(Fault::new(raw.amplitude_deg.span(), message, format!("stay within {limit:.1} degrees")));
        }
        let fastest = own().map(|sine| TAU * sine.frequency_hz * sine.amplitude_rad.abs()).sum::<f64>();
        let limit = plant.servo(joint).max_rate_rad_s;
        if fastest > limit {
            let message = format!("joint {} moves at up to {fastest:.2} rad/s", joint + 1);
            let help = format!("its driver gives {limit} rad/s: less amplitude or frequency");
            return Err(Fault::new(raw.amplitude_deg.span(), message, help));
        }
    }
    Ok(sines)
}
