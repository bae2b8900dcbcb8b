//! The target: the body itself, and the base's goals that go by it.

use super::conditions::positive;
use super::{Checked, For, number, number_or_zero, on_table, ranges, refuse_all};
use crate::error::Fault;
use crate::file::{BaseGoal, TargetBody, raw};
use toml::Spanned;

/// The body to be captured.
pub(super) fn body(raw: &raw::Target, plant: For) -> Checked<TargetBody> {
    let more_than_0 = |value: &raw::Number| match number(value)? {
        amount if amount > 0.0 => Ok(amount),
        amount => Err(Fault::new(value.span(), format!("a target cannot have {amount} here"), "give more than 0")),
    };
    Ok(TargetBody {
        body: fss_plant::Target {
            mass_kg: more_than_0(&raw.mass_kg)?,
            inertia_kg_m2: more_than_0(&raw.inertia_kg_m2)?,
            radius_m: more_than_0(&raw.radius_m)?,
            restitution: 0.0,
            pose: [
                on_table(Some(&raw.x_m), 0, plant)?,
                on_table(Some(&raw.y_m), 1, plant)?,
                number_or_zero(raw.theta_deg.as_ref())?.to_radians(),
            ],
            velocity: [
                number_or_zero(raw.vx_m_s.as_ref())?,
                number_or_zero(raw.vy_m_s.as_ref())?,
                number_or_zero(raw.omega_deg_s.as_ref())?.to_radians(),
            ],
        },
        ranges: ranges(&raw.draw)?,
    })
}

/// The base's goal to meet the target.
pub(super) fn meet(raw: &raw::Base) -> Checked<BaseGoal> {
    let Some(standoff) = &raw.standoff_m else {
        return Err(Fault::new(raw.goal.span(), "missing field `standoff_m`", "say how far before the handle"));
    };
    Ok(BaseGoal::Meet { standoff_m: positive(standoff)? })
}

/// The base's goal to take the held target to a pose.
pub(super) fn carry(raw: &raw::Base, plant: For) -> Checked<BaseGoal> {
    let relative = ("relative", raw.relative.as_ref().map(Spanned::span));
    refuse_all([relative].into_iter(), "the target's pose is in the table frame")?;
    let (Some(_), Some(_), Some(_)) = (&raw.x_m, &raw.y_m, &raw.theta_deg) else {
        let help = "give x_m, y_m and theta_deg of the target in the table frame";
        return Err(Fault::new(raw.goal.span(), "nothing says where the target shall be carried", help));
    };
    Ok(BaseGoal::Carry {
        pose: [
            on_table(raw.x_m.as_ref(), 0, plant)?,
            on_table(raw.y_m.as_ref(), 1, plant)?,
            number_or_zero(raw.theta_deg.as_ref())?.to_radians(),
        ],
    })
}
