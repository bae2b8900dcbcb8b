//! What may be told: rules against names that fit and are not there.

use super::screen::likeness;
use super::{Contest, Refined};
use crate::tolerance::unsaid;
use fss_plant::{Effect, Place};

/// What a cause must gain (fall of the sum of squares, in units of what noise and everything unexplained make of one degree
/// of freedom) before anybody is told of it. What the arm does between two reports nobody knows, and causes that lie there
/// gain from it; of those that act on the base every window tells anew.
pub(super) const LEAST_GAIN: f64 = 60.0;
const LEAST_GAIN_AT_BASE: f64 = 30.0;
/// More where its beginning was chosen too.
const LEAST_GAIN_OF_ONSET: f64 = 100.0;
/// A cause within so many of the deviations that go without saying is not worth a name.
const WORTH_SAYING: f64 = 3.0;
/// Nor is an elastic drive stiffer than this, rad/(N m). Motion between reports is interpolated, which flattens accelerations; on a
/// light base that looks like a stiff elastic drive.
const LEAST_COMPLIANCE_RAD_N_M: f64 = 9e-4;
/// Nor play narrower than this, rad: the windows have no state for a link that swings on its drive, and such a swing looks like some
/// tenths of a milliradian of play.
const LEAST_PLAY_RAD: f64 = 6.5e-4;
/// Nor a kinematic error of fewer periods a turn than this: over what a joint sweeps it is an offset and a scale of its encoder.
const FEWEST_CYCLES: f64 = 0.8;
/// Where a log tells what links were told, their fast motion follows that, and a latency of telemetry moves the slow one alone. When
/// commands arrive (2 to 8 ms over the radio) and how servos follow them then counts many times: they are taken as exact.
/// What is timed against the arm hangs on that too.
pub(super) const LATENCY_BESIDE_COMMANDS_S: f64 = 1.5e-3;
/// Nor, where a log tells what links were told, telemetry that is later by less than twice what latencies come out wrong by there.
const LEAST_LATENCY_BESIDE_COMMANDS_S: f64 = 2.0 * LATENCY_BESIDE_COMMANDS_S;
/// And the share of what is still unexplained.
const LEAST_SHARE: f64 = 0.12;
const LEAST_SHARE_OF_ONSET: f64 = 0.4;
/// Mean square beyond which names are given only to what explains most of the misfit.
pub(crate) const DOUBTFUL: f64 = 2.0;
/// Mean square up to which nothing counts as unexplained there.
const NEARLY_ALL: f64 = 1.25;
/// What a left-out run must keep of the gain.
const LEAST_KEPT: f64 = 0.3;
/// Cosine from which on two causes do the same: together they would say how much the one exceeds the other, and be both
/// as large as one likes.
const ONE_AND_THE_SAME: f64 = 0.95;

impl Contest {
    /// Sum of squares and what each parameter costs: of two causes that fit alike, the one with fewer parameters.
    pub(super) fn cost(refined: &Refined) -> f64 {
        let count: usize = refined.effects.iter().map(|e| e.values().len() + usize::from(e.onset_s().is_some())).sum();
        refined.chi2 + 12.0 * count as f64 * unit(refined)
    }

    /// Whether the data insist on the last cause of `next`.
    pub(super) fn insists(&self, now: &Refined, next: &Refined) -> bool {
        let gain = now.chi2 - next.chi2;
        // Where nearly all is explained, a small share of the rest is worth telling too.
        let excess = now.chi2 - NEARLY_ALL * now.freedom;
        let share = if excess > 0.0 { gain / excess } else { 1.0 };
        let last = next.effects.len() - 1;
        let idle = self.hypotheses[next.hypotheses[last]].is_idle(&next.effects[last]);
        let (least, least_share) = match next.effects[last].onset_s() {
            Some(_) => (LEAST_GAIN_OF_ONSET, LEAST_SHARE_OF_ONSET),
            None => (least_gain(&next.effects[last]), LEAST_SHARE),
        };
        !idle
            && self.may_be_told(next, last)
            && self.sides_agree(next, last)
            && gain / unit(next) > least
            && share > least_share
            && self.kept(next, last) > LEAST_KEPT
    }

    /// Whether a cause is beyond what every laboratory is off by.
    pub(super) fn is_worth_saying(&self, hypothesis: usize, effect: &Effect) -> bool {
        let hypothesis = &self.hypotheses[hypothesis];
        let Some(sds) = unsaid(hypothesis, &self.trial.plant) else { return true };
        let (values, nominal) = (effect.values(), hypothesis.nominal.values());
        if hypothesis.is_compliance() {
            return 1.0 / values[0] > (WORTH_SAYING * sds[0]).max(LEAST_COMPLIANCE_RAD_N_M);
        }
        let is_too_slow = effect.id() == "drive_kinematic_error" && values[1] < FEWEST_CYCLES;
        let is_too_short = effect.id() == "link_latency"
            && self.tells_commands()
            && (values[0] - nominal[0]).abs() < LEAST_LATENCY_BESIDE_COMMANDS_S;
        !is_too_slow
            && !is_too_short
            && values.iter().zip(nominal).zip(&sds).any(|((v, n), sd)| (v - n).abs() > WORTH_SAYING * sd)
    }

    /// Whether a cause stands beside another one of its joint, and one of the two is a drive that is simulated. It is simulated
    /// with the plant file's link and motor: where those are others, a servo moves its link otherwise, and a softer drive fits that
    /// better; and a motor whose link swings needs another current than its smooth motion does.
    fn shares_a_simulated_drive(&self, refined: &Refined, which: usize) -> bool {
        let is_simulated = |i: usize| self.is_simulated(refined.hypotheses[i], &refined.effects[i]);
        let joint = |i: usize| joint_moved(&refined.effects[i], self.trial.plant.link_count());
        (0..refined.effects.len()).any(|i| {
            i != which && joint(i).is_some() && joint(i) == joint(which) && (is_simulated(i) || is_simulated(which))
        })
    }

    /// Whether cause `which` may stand where a refit puts it, as what it is.
    pub(super) fn may_be_told(&self, refined: &Refined, which: usize) -> bool {
        let effect = &refined.effects[which];
        self.is_worth_saying(refined.hypotheses[which], effect)
            && is_wide(effect)
            && stands_apart(refined, which)
            && !is_behind_play(&refined.effects, which)
            && !self.shares_a_simulated_drive(refined, which)
    }
}

/// What a cause that is there from the start must gain.
pub(super) fn least_gain(effect: &Effect) -> f64 {
    match effect.about().place {
        Place::Base | Place::Mass | Place::Thruster => LEAST_GAIN_AT_BASE,
        _ => LEAST_GAIN,
    }
}

/// Whether a joint's play, fitted, is more than what a soft drive that swings is taken for; true of every other cause.
fn is_wide(effect: &Effect) -> bool {
    effect.id() != "joint_backlash" || effect.values()[0] > LEAST_PLAY_RAD
}

/// Whether a cause is one that only a motor's current or torque shows, of a joint that has play. While its teeth are apart a motor
/// turns alone, and neither tells anything of what the link gets: it looks like a motor without torque, or without friction.
fn is_behind_play(effects: &[Effect], which: usize) -> bool {
    const BY_CURRENT: [&str; 5] = [
        "torque_constant",
        "torque_sensor",
        "joint_coulomb_friction",
        "joint_viscous_friction",
        "joint_stribeck_friction",
    ];
    let own = &effects[which];
    let has_play = |other: &Effect| other.id() == "joint_backlash" && other.index() == own.index();
    BY_CURRENT.contains(&own.id()) && effects.iter().any(has_play)
}

/// The joint of which a cause changes how its drive moves its link; what the arm holds in hand is the last link's.
fn joint_moved(effect: &Effect, links: usize) -> Option<usize> {
    match effect.about().place {
        _ if effect.id() == "payload" => Some(links),
        Place::Joint | Place::Mass => effect.index(),
        _ => None,
    }
}

/// Whether one of several causes does something else than the others together, where they are.
fn stands_apart(refined: &Refined, which: usize) -> bool {
    let own: Vec<usize> = refined.columns_of(which).collect();
    let others: Vec<usize> = (0..refined.clear.len()).filter(|k| !own.contains(k)).collect();
    own.is_empty() || others.is_empty() || likeness(&refined.clear, &own, &others) < ONE_AND_THE_SAME
}

/// What noise and everything unexplained make of one degree of freedom.
pub(super) fn unit(refined: &Refined) -> f64 {
    refined.mean_square().max(0.8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_only_a_current_shows_is_not_told_beside_play_of_the_same_joint() -> Result<(), fss_plant::EffectError> {
        let play = Effect::new("joint_backlash")?.at(1);
        let motor = |joint: usize| Ok::<_, fss_plant::EffectError>(Effect::new("torque_constant")?.at(joint));
        assert!(is_behind_play(&[play.clone(), motor(1)?], 1));
        assert!(!is_behind_play(&[play.clone(), motor(2)?], 1));
        assert!(!is_behind_play(&[play, motor(1)?], 0), "the play itself is told");
        Ok(())
    }

    #[test]
    fn links_motors_and_payloads_change_how_a_joint_moves_and_encoders_do_not() -> Result<(), fss_plant::EffectError> {
        for (id, joint, moved) in [
            ("joint_flexibility", 3, Some(3)),
            ("link_inertia", 4, Some(4)),
            ("torque_constant", 2, Some(2)),
            ("encoder_offset", 4, None),
        ] {
            assert_eq!(joint_moved(&Effect::new(id)?.at(joint), 4), moved, "{id} {joint}");
        }
        assert_eq!(joint_moved(&Effect::new("payload")?, 4), Some(4), "held by the last link");
        assert_eq!(joint_moved(&Effect::new("base_inertia")?, 4), None);
        Ok(())
    }
}
