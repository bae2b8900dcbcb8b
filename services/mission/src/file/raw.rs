//! The mission file as it is written: keys, and where in the text their values stand.

use serde::Deserialize;
use serde::de::IgnoredAny;
use toml::Spanned;

pub(super) type Number = Spanned<f64>;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Mission {
    pub(super) name: Spanned<String>,
    #[serde(default)]
    pub(super) description: String,
    #[serde(default)]
    pub(super) initial: Initial,
    pub(super) phase: Spanned<Vec<Spanned<Phase>>>,
    /// Phases that are flown only where a phase's `on_abort` names them.
    #[serde(default)]
    pub(super) abort: Vec<Spanned<Phase>>,
    pub(super) target: Option<Spanned<Target>>,
    pub(super) limits: Option<Limits>,
    /// What goes wrong in the simulated laboratory: the laboratory reads it, a mission does not know.
    #[serde(default, rename = "network")]
    _network: IgnoredAny,
    #[serde(default, rename = "fault")]
    _fault: IgnoredAny,
    /// Services on demand: the launcher starts them.
    #[serde(default, rename = "services")]
    _services: IgnoredAny,
}

#[derive(Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct Initial {
    pub(super) q_deg: Option<Spanned<Vec<Number>>>,
    pub(super) qd_deg_s: Option<Spanned<Vec<Number>>>,
    pub(super) x_m: Option<Number>,
    pub(super) y_m: Option<Number>,
    pub(super) theta_deg: Option<Number>,
    pub(super) vx_m_s: Option<Number>,
    pub(super) vy_m_s: Option<Number>,
    pub(super) omega_deg_s: Option<Number>,
    pub(super) draw: Option<Draw>,
}

/// Ranges from which a run's seed draws what is added to a start.
#[derive(Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct Draw {
    pub(super) x_m: Option<Range>,
    pub(super) y_m: Option<Range>,
    pub(super) theta_deg: Option<Range>,
    pub(super) drift_m_s: Option<Range>,
    pub(super) spin_deg_s: Option<Range>,
}

pub(super) type Range = Spanned<[f64; 2]>;

/// The body to be captured.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Target {
    pub(super) mass_kg: Number,
    pub(super) inertia_kg_m2: Number,
    pub(super) radius_m: Number,
    pub(super) x_m: Number,
    pub(super) y_m: Number,
    pub(super) theta_deg: Option<Number>,
    pub(super) vx_m_s: Option<Number>,
    pub(super) vy_m_s: Option<Number>,
    pub(super) omega_deg_s: Option<Number>,
    #[serde(default)]
    pub(super) draw: Draw,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Limits {
    pub(super) gas_g: Option<Number>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Phase {
    pub(super) name: Option<String>,
    pub(super) duration_s: Number,
    pub(super) settle_s: Option<Number>,
    pub(super) until: Option<Spanned<Until>>,
    pub(super) timeout_s: Option<Number>,
    pub(super) on_abort: Option<Spanned<String>>,
    pub(super) gripper: Option<Gripper>,
    pub(super) base: Base,
    pub(super) arm: Spanned<Arm>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Until {
    pub(super) condition: Spanned<Condition>,
    pub(super) for_s: Option<Number>,
    pub(super) speed_m_s: Option<Number>,
    pub(super) omega_deg_s: Option<Number>,
    pub(super) distance_m: Option<Number>,
}

#[derive(Clone, Copy, PartialEq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Condition {
    Still,
    Arrived,
    TargetSeen,
    Grasped,
    Released,
}

#[derive(Clone, Copy, PartialEq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Gripper {
    Open,
    Closed,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Base {
    pub(super) goal: Spanned<BaseGoal>,
    pub(super) x_m: Option<Number>,
    pub(super) y_m: Option<Number>,
    pub(super) theta_deg: Option<Number>,
    pub(super) relative: Option<Spanned<bool>>,
    pub(super) pulses: Option<Spanned<Vec<Spanned<Pulse>>>>,
    pub(super) standoff_m: Option<Number>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Pulse {
    pub(super) at_s: Number,
    pub(super) for_s: Number,
    pub(super) thrusters: Spanned<Vec<Spanned<usize>>>,
}

#[derive(Clone, Copy, PartialEq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum BaseGoal {
    Free,
    Hold,
    Goto,
    Carry,
    Valves,
    Stop,
    Meet,
    Follow,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Arm {
    pub(super) goal: Spanned<ArmGoal>,
    pub(super) q_deg: Option<Spanned<Vec<Number>>>,
    pub(super) length_m: Option<Number>,
    pub(super) direction_deg: Option<Number>,
    pub(super) keep_orientation: Option<Spanned<bool>>,
    pub(super) sines: Option<Spanned<Vec<Spanned<Sine>>>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Sine {
    pub(super) joint: Spanned<usize>,
    pub(super) amplitude_deg: Number,
    #[serde(rename = "frequency_Hz")]
    pub(super) frequency_hz: Number,
    #[serde(default)]
    pub(super) phase_deg: Option<Number>,
}

#[derive(Clone, Copy, PartialEq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum ArmGoal {
    Off,
    Hold,
    Joints,
    Sines,
    Line,
    ZeroReaction,
    Capture,
    Follow,
}
