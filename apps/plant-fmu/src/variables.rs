//! The variables of a plant's FMU, in the order of their value references.

use fss_plant::Plant;

/// What a variable is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Causality {
    /// Set before the start.
    Parameter,
    /// Set before each step.
    Input,
    /// Read after it.
    Output,
    /// Time, which the others depend on.
    Independent,
}

/// What an output shows, what an input or a parameter sets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Meaning {
    /// Seed of the disturbances.
    Seed,
    /// Pose (0 to 2) and velocity (3 to 5) of the base at the start.
    StartBase(usize),
    /// Angle of a joint at the start.
    StartJoint(usize),
    /// Level of a thruster, 0 shut to 1 open.
    Valve(usize),
    /// What the driver of a joint does: 0 off, 1 current, 2 rate, 3 angle.
    Mode(usize),
    /// Current that it gives.
    Current(usize),
    /// Rate that it holds, or feeds forward.
    Rate(usize),
    /// Angle that it holds.
    Angle(usize),
    /// Pose and velocity of the base.
    Base(usize),
    /// Pose and velocity of the end-effector.
    EndEffector(usize),
    /// Pose and velocity of the target.
    Target(usize),
    /// Encoder angle of a joint.
    Encoder(usize),
    /// Rate of a joint.
    JointRate(usize),
    /// Current of its motor.
    MotorCurrent(usize),
    /// Torque at its sensor.
    Torque(usize),
    /// Gas used since the start.
    Gas,
    /// Time since the start.
    Time,
}

/// A variable; its value reference is its place in the list.
#[derive(Clone, Debug)]
pub struct Variable {
    /// Its name.
    pub name: String,
    /// What it is for.
    pub causality: Causality,
    /// What it means.
    pub meaning: Meaning,
    /// Its unit; empty for none.
    pub unit: &'static str,
    /// Its value where nobody sets it.
    pub start: f64,
    /// A sentence about it.
    pub about: String,
}

const POSE: [(&str, &str, &str); 6] = [
    ("x_m", "m", "position along the table's x"),
    ("y_m", "m", "position along the table's y"),
    ("theta_rad", "rad", "heading"),
    ("vx_m_s", "m/s", "velocity along the table's x"),
    ("vy_m_s", "m/s", "velocity along the table's y"),
    ("omega_rad_s", "rad/s", "rate about the vertical"),
];

/// The variables of a plant.
pub fn variables(plant: &Plant) -> Vec<Variable> {
    use Causality::{Independent, Input, Parameter};
    let mut all = Vec::new();
    let mut add = |name, causality, meaning, unit, start, about: &str| {
        all.push(Variable { name, causality, meaning, unit, start, about: about.to_owned() });
    };
    add("seed".to_owned(), Parameter, Meaning::Seed, "", 1.0, "of the table's disturbances, a whole number");
    for (i, (name, unit, about)) in POSE.iter().enumerate() {
        add(
            format!("start.{name}"),
            Parameter,
            Meaning::StartBase(i),
            unit,
            0.0,
            &format!("base at the start: {about}"),
        );
    }
    let links = plant.link_count();
    for i in 0..links {
        let (name, about) = (format!("start.q{}_rad", i + 1), format!("joint {} at the start", i + 1));
        add(name, Parameter, Meaning::StartJoint(i), "rad", 0.0, &about);
    }
    for i in 0..plant.thrusters.len() {
        let about = format!("level of thruster {}: 0 shuts its valve, 1 opens it", i + 1);
        add(format!("valve_{}", i + 1), Input, Meaning::Valve(i), "", 0.0, &about);
    }
    for i in 0..links {
        let joint = i + 1;
        let of = |what: &str| format!("driver of joint {joint}: {what}");
        add(format!("joint_{joint}.mode"), Input, Meaning::Mode(i), "", 1.0, &of("0 off, 1 current, 2 rate, 3 angle"));
        add(format!("joint_{joint}.current_a"), Input, Meaning::Current(i), "A", 0.0, &of("current in mode 1"));
        add(
            format!("joint_{joint}.qd_rad_s"),
            Input,
            Meaning::Rate(i),
            "rad/s",
            0.0,
            &of("rate in mode 2, fed forward in 3"),
        );
        add(format!("joint_{joint}.q_rad"), Input, Meaning::Angle(i), "rad", 0.0, &of("angle in mode 3"));
    }
    outputs(plant, &mut add);
    add("time".to_owned(), Independent, Meaning::Time, "s", 0.0, "time since the start");
    all
}

/// Takes a variable: name, causality, meaning, unit, start value and what it is.
type Add<'a> = dyn FnMut(String, Causality, Meaning, &'static str, f64, &str) + 'a;

fn outputs(plant: &Plant, add: &mut Add) {
    use Causality::Output;
    let links = plant.link_count();
    type OfBody = fn(usize) -> Meaning;
    let bodies: [(&str, OfBody); 3] =
        [("base", Meaning::Base), ("end_effector", Meaning::EndEffector), ("target", Meaning::Target)];
    for (body, meaning) in bodies {
        let is_there = match body {
            "target" => plant.target.is_some(),
            "end_effector" => links > 0,
            _ => true,
        };
        for (i, (name, unit, about)) in POSE.iter().enumerate().filter(|_| is_there) {
            add(format!("{body}.{name}"), Output, meaning(i), unit, 0.0, &format!("{body}: {about}"));
        }
    }
    for i in 0..links {
        let link = i + 1;
        let of = |what: &str| format!("{what} of joint {link}");
        add(format!("link_{link}.q_rad"), Output, Meaning::Encoder(i), "rad", 0.0, &of("encoder angle"));
        add(format!("link_{link}.qd_rad_s"), Output, Meaning::JointRate(i), "rad/s", 0.0, &of("rate"));
        add(format!("link_{link}.current_a"), Output, Meaning::MotorCurrent(i), "A", 0.0, &of("motor current"));
        add(format!("link_{link}.torque_nm"), Output, Meaning::Torque(i), "N.m", 0.0, &of("torque at the sensor"));
    }
    add("gas_used_kg".to_owned(), Output, Meaning::Gas, "kg", 0.0, "gas used since the start");
}
