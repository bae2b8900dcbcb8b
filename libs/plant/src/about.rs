//! The description of a kind of effect: where it acts, what its index counts, its parameters.

/// Most parameters that any effect has.
pub const MAX_PARAMETERS: usize = 6;

/// The values of an effect with one parameter.
pub(crate) fn alone(value: f64) -> [f64; MAX_PARAMETERS] {
    let mut values = [0.0; MAX_PARAMETERS];
    values[0] = value;
    values
}

/// Where an effect acts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Place {
    /// Force or torque on the base, or acceleration of every body.
    Base,
    /// A mass, centre of mass or moment of inertia.
    Mass,
    /// Torque or geometry of a joint.
    Joint,
    /// A thruster.
    Thruster,
    /// What a sensor says.
    Sensor,
    /// When something is said or done.
    Time,
    /// Not in the catalogue.
    Unknown,
}

impl Place {
    /// The word for reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Base => "base",
            Self::Mass => "mass",
            Self::Joint => "joint",
            Self::Thruster => "thruster",
            Self::Sensor => "sensor",
            Self::Time => "time",
            Self::Unknown => "unknown",
        }
    }
}

/// What an effect's `index` counts, from 1. Without an index it is all of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Index {
    /// The effect is there once.
    None,
    /// Thrusters.
    Thruster,
    /// Links.
    Link,
    /// Joints.
    Joint,
    /// Not a number: the name of a data stream, in `channel`.
    Channel,
}

impl Index {
    /// The word for reports and error messages.
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "",
            Self::Thruster => "thruster",
            Self::Link => "link",
            Self::Joint => "joint",
            Self::Channel => "channel",
        }
    }
}

/// One parameter of an effect.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parameter {
    /// Key in the plant file, ending with the unit.
    pub name: &'static str,
    /// Unit for people; empty is a pure number.
    pub unit: &'static str,
    /// What it is, for the documentation.
    pub meaning: &'static str,
    /// Value at which the effect does nothing; `None` is the plant's own value, which
    /// [`crate::EffectKind::nominal`] knows.
    pub nominal: Option<f64>,
    /// Smallest value that makes sense.
    pub lower: f64,
    /// Largest value that makes sense.
    pub upper: f64,
    /// Typical size of a departure from nominal: the unit for searching and differencing.
    pub scale: f64,
}

impl Parameter {
    /// A parameter whose nominal value is 0, without bounds.
    pub const fn new(name: &'static str, unit: &'static str, meaning: &'static str) -> Self {
        Self { name, unit, meaning, nominal: Some(0.0), lower: f64::MIN, upper: f64::MAX, scale: 1.0 }
    }

    /// The same with another nominal value.
    #[must_use]
    pub const fn nominal(mut self, nominal: f64) -> Self {
        self.nominal = Some(nominal);
        self
    }

    /// The same, replacing a value of the plant.
    #[must_use]
    pub const fn of_plant(mut self) -> Self {
        self.nominal = None;
        self
    }

    /// The same with bounds.
    #[must_use]
    pub const fn within(mut self, lower: f64, upper: f64) -> Self {
        self.lower = lower;
        self.upper = upper;
        self
    }

    /// The same with a typical size.
    #[must_use]
    pub const fn scale(mut self, scale: f64) -> Self {
        self.scale = scale;
        self
    }
}

/// What a kind of effect is, without its action.
#[derive(Debug, Clone, Copy)]
pub struct About {
    /// Name in plant files and reports.
    pub id: &'static str,
    /// What it does, one sentence.
    pub sentence: &'static str,
    /// Where it acts.
    pub place: Place,
    /// What its index counts.
    pub index: Index,
    /// Its parameters, at most [`MAX_PARAMETERS`].
    pub parameters: &'static [Parameter],
}
