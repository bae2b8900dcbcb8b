//! Laws that no known effect is: what acts on the base in time or by its heading, on a joint by its angle or its rate.

use super::Candidate;
use fss_plant::{Effect, Plant, Prior};
use std::f64::consts::{PI, TAU};

/// A law that no known effect is, and what it depends on: `unmodelled` on one of its channels.
const BASE_LAWS: [(&str, Period); 3] =
    [("base_force", Period::Run), ("base_torque", Period::Run), ("base_torque_by_heading", Period::Turn)];
/// Periods of a turn that a torque by heading is tried with.
const TURNS: [f64; 2] = [1.0, 2.0];
/// Frequencies of a force in time: multiples of half the inverse run length, up to this many.
const HARMONICS: usize = 40;

/// Torque of a law of joints, as a share of the largest: whatever resists, it leaves a joint able to move.
const LAW_SHARE: f64 = 0.03;
/// Most periods that a torque by a joint's angle has in a turn.
const MOST_A_TURN: f64 = 30.0;

/// What a law's frequencies are multiples of.
#[derive(Clone, Copy, PartialEq)]
enum Period {
    Run,
    Turn,
}

/// A law of joints of so many coordinates.
fn joint_law(nominal: Effect, by: &str, typical: f64, size: usize) -> Candidate {
    Candidate {
        nominal,
        kind: format!("unmodelled joint_torque_by_{by}"),
        prior: Prior::sized(&vec![typical; size], &vec![1e-3 * typical; size]),
        shape: 0.0,
        spacing: None,
        size,
        is_law: true,
    }
}

/// Of a clamped arm: torques against the square of a joint's rate. What was fitted says nothing of other rates.
pub(super) fn laws_by_rate(plant: &Plant, rates_rad_s: &[[f64; 2]]) -> Vec<Candidate> {
    let law = |(joint, [from, to]): (usize, &[f64; 2])| {
        let mut nominal = Effect::new("unmodelled").ok()?.on(&format!("joint_torque_{}_by_rate", joint + 1));
        nominal.set("from", *from).and_then(|()| nominal.set("to", *to)).ok()?;
        let typical = LAW_SHARE * plant.typical_joint_torque_n_m(joint) / plant.typical_joint_rate_rad_s(joint).powi(2);
        Some(joint_law(nominal, "rate", typical, 1))
    };
    rates_rad_s.iter().enumerate().filter_map(law).collect()
}

/// Torques by a joint's angle, of one period or more over its range, half a turn at the most, in steps of half a period. Those of less
/// are as of springs.
pub(super) fn laws_by_angle(plant: &Plant, ranges_rad: &[f64]) -> Vec<Candidate> {
    let of_joint = |(joint, range_rad): (usize, &f64)| {
        let spacing = TAU / (2.0 * range_rad.min(PI));
        let nominal = Effect::new("unmodelled").map(|e| e.on(&format!("joint_torque_{}_by_angle", joint + 1)));
        let law = nominal.map(|e| joint_law(e, "angle", LAW_SHARE * plant.typical_joint_torque_n_m(joint), 2));
        let count = (MOST_A_TURN / spacing) as usize;
        let with_period = move |k: usize| {
            law.clone().map(|law| Candidate { shape: k as f64 * spacing, spacing: Some(spacing), ..law })
        };
        (2..=count).flat_map(with_period)
    };
    ranges_rad.iter().enumerate().flat_map(of_joint).collect()
}

/// Forces and torques on a floating base, in time and by its heading.
pub(super) fn base_laws(plant: &Plant, duration_s: f64) -> Vec<Candidate> {
    let (mass, inertia) = (plant.total_mass_kg(), plant.total_inertia_kg_m2());
    let mut all = Vec::new();
    for (channel, period) in BASE_LAWS {
        let Ok(nominal) = Effect::new("unmodelled").map(|e| e.on(channel)) else { continue };
        let is_force = channel == "base_force";
        let typical = if is_force { 1.5e-3 * mass } else { 5e-3 * inertia };
        let size = if is_force { 4 } else { 2 };
        let prior = Prior::sized(&vec![typical; size], &vec![1e-3 * typical; size]);
        let spacing = 1.0 / (2.0 * duration_s);
        let (frequencies, spacing): (Vec<f64>, _) = match period {
            Period::Run => ((1..=HARMONICS).map(|k| k as f64 * spacing).collect(), Some(spacing)),
            Period::Turn => (TURNS.to_vec(), None),
        };
        all.extend(frequencies.into_iter().map(|shape| Candidate {
            nominal: nominal.clone(),
            kind: format!("unmodelled {channel}"),
            prior,
            shape,
            spacing,
            size,
            is_law: true,
        }));
    }
    all
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn a_joint_that_turns_round_is_tried_with_whole_periods_a_turn_and_one_that_rests_with_none() {
        let plant = Plant::default_laboratory().unwrap();
        let laws = laws_by_angle(&plant, &[40.0, 0.0, TAU / 4.0]);
        let periods_a_turn = |joint: usize| -> Vec<f64> {
            let channel = format!("joint_torque_{joint}_by_angle");
            laws.iter().filter(|c| c.nominal.channel() == Some(&channel)).map(|c| c.shape).collect()
        };
        let whole = (2..=30).map(f64::from).collect::<Vec<_>>();
        assert_eq!([1, 2, 3].map(periods_a_turn), [whole, vec![], (2..=15).map(|k| 2.0 * f64::from(k)).collect()]);
    }
}
