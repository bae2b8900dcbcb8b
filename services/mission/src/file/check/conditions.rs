//! What ends a phase, and what follows where it fails.

use super::{Checked, number, refuse_all};
use crate::error::Fault;
use crate::file::{Condition, Until, raw};
use toml::Spanned;

/// The longest time-out, s.
const LONGEST_S: f64 = 3600.0;

/// The condition that ends a phase whose goals take `duration_s`.
pub(super) fn until(phase: &raw::Phase, duration_s: f64) -> Checked<Option<Until>> {
    let Some(spanned) = &phase.until else {
        let keys = [("timeout_s", phase.timeout_s.as_ref().map(Spanned::span))];
        refuse_all(keys.into_iter(), "only a phase that ends with a condition (`until`) can time out")?;
        return Ok(None);
    };
    if let Some(settle) = &phase.settle_s {
        let help =
            "a phase ends with its time (settle_s) or with a condition (until, timeout_s); remove one of the two";
        return Err(Fault::new(settle.span(), "`settle_s` contradicts `until`", help));
    }
    let Some(timeout) = &phase.timeout_s else {
        let help = "add timeout_s: what does not come must not be waited for without end";
        return Err(Fault::new(spanned.span(), "missing field `timeout_s`", help));
    };
    let timeout_s = number(timeout)?;
    if !(timeout_s >= duration_s && timeout_s <= LONGEST_S) {
        let help = format!("give from the phase's duration_s, {duration_s}, to {LONGEST_S} s");
        return Err(Fault::new(timeout.span(), format!("a phase cannot time out after {timeout_s} s"), help));
    }
    let raw = spanned.get_ref();
    let for_s = raw.for_s.as_ref().map_or(Ok(0.0), positive)?;
    let condition = condition(raw)?;
    Ok(Some(Until { condition, for_s, timeout_s }))
}

fn condition(raw: &raw::Until) -> Checked<Condition> {
    let tells = |name: &'static str, value: &Option<raw::Number>| (name, value.as_ref().map(Spanned::span));
    let needs = |name: &str, value: &Option<raw::Number>| {
        value.as_ref().map_or_else(
            || {
                let message = format!("missing field `{name}`");
                Err(Fault::new(raw.condition.span(), message, "say how near is near enough"))
            },
            positive,
        )
    };
    let (distance, speed, omega) = (
        tells("distance_m", &raw.distance_m),
        tells("speed_m_s", &raw.speed_m_s),
        tells("omega_deg_s", &raw.omega_deg_s),
    );
    match raw.condition.get_ref() {
        raw::Condition::Still => {
            refuse_all([distance].into_iter(), "only \"arrived\" takes it")?;
            let speed_m_s = needs("speed_m_s", &raw.speed_m_s)?;
            Ok(Condition::Still { speed_m_s, omega_rad_s: needs("omega_deg_s", &raw.omega_deg_s)?.to_radians() })
        }
        raw::Condition::Arrived => {
            refuse_all([omega].into_iter(), "only \"still\" takes it")?;
            let distance_m = needs("distance_m", &raw.distance_m)?;
            Ok(Condition::Arrived { distance_m, speed_m_s: needs("speed_m_s", &raw.speed_m_s)? })
        }
        other => {
            refuse_all([distance, speed, omega].into_iter(), "this condition takes no bounds")?;
            Ok(match other {
                raw::Condition::TargetSeen => Condition::TargetSeen,
                raw::Condition::Released => Condition::Released,
                _ => Condition::Grasped,
            })
        }
    }
}

pub(super) fn positive(value: &raw::Number) -> Checked<f64> {
    match number(value)? {
        amount if amount > 0.0 => Ok(amount),
        amount => Err(Fault::new(value.span(), format!("{amount} is never reached"), "give more than 0")),
    }
}

/// The number of the [[abort]] phase that this one names.
pub(super) fn on_abort(phase: &raw::Phase, names: &[String]) -> Checked<Option<usize>> {
    let Some(wanted) = &phase.on_abort else { return Ok(None) };
    let found = names.iter().position(|name| name == wanted.get_ref());
    found.map(Some).ok_or_else(|| {
        let message = format!("there is no [[abort]] phase named '{}'", wanted.get_ref());
        let help = if names.is_empty() {
            "add an [[abort]] table with this name and with goals for base and arm".to_owned()
        } else {
            format!("the mission's [[abort]] phases are {}", names.join(", "))
        };
        Fault::new(wanted.span(), message, help)
    })
}
