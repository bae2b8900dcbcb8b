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
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Phase {
    pub(super) name: Option<String>,
    pub(super) duration_s: Number,
    pub(super) settle_s: Option<Number>,
    pub(super) base: Base,
    pub(super) arm: Spanned<Arm>,
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
    Valves,
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
}
